//! From frames to embeddings, at most once per frame.

mod cache;
mod segment;

use std::collections::{HashMap, HashSet};
use std::iter;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, Result, bail, ensure};
use rayon::prelude::*;
use sps_base::parallel;
use sps_dataset::{Frame, FrameIndex, FrameKey, Source};
use sps_estimator::{Embedder, Network, Precomputed};

use cache::{EmbeddingCache, Seen};
use segment::Segment;

use crate::config::Experiment;
use crate::progress::{Progress, ensure_wanted};
use crate::work::{Undone, Work};

/// Frames decoded ahead while as many are encoded, and bytes of them: each thread may be at work on
/// one frame more.
const FRAMES_AT_ONCE: usize = 32;
const BYTES_AT_ONCE: usize = 256 << 20;

/// Frames after which a shard looks what others have encoded.
const BLOCK: usize = 4 * FRAMES_AT_ONCE;

/// Embeds the given frames of `source`, `(frames, width)`, decoding only what the experiment's cache lacks, and
/// says how many that were; where a file has the embeddings, none.
///
/// Shards that share a cache help one another: each goes over all frames block by block, its own
/// blocks first, and encodes what no other has until then. So none waits, and none depends on another.
pub(crate) fn embed(
    source: &dyn Source,
    frames: &[FrameIndex],
    embedder: &Embedder,
    experiment: &Experiment,
) -> Result<(Vec<f32>, usize)> {
    let width = embedder.width();
    if let Network::Precomputed(rows) = embedder.network() {
        return Ok((of_file(source, frames, rows)?, 0));
    }
    let (identity, work) = (embedder.identity(), experiment.work);
    let cache = &EmbeddingCache::open(&experiment.cache, identity, width, work)?;
    let key = |frame: &FrameIndex| source.frame_key(frame.surface, frame.view);
    let keys = parallel::map(frames, key).into_iter();
    let keys = keys.collect::<Result<Vec<FrameKey>, _>>()?;
    let (wanted, names) = (once_each(frames, &keys), keys.iter().copied().collect());
    let (mut rows, mut seen) = (HashMap::new(), Seen::new());
    let mut frames_decoded = 0;
    for block in blocks(cache.work, wanted.len()) {
        rows.extend(cache.get(&names, &mut seen)?);
        let missing = wanted[block].iter();
        let missing = missing.filter(|(key, _)| !rows.contains_key(key));
        let missing: Vec<Wanted> = missing.copied().collect();
        if cache.work == Work::None && !missing.is_empty() {
            bail!(Undone::Frames(missing.len()));
        }
        encode_missing(source, &missing, embedder, cache, &mut rows)?;
        frames_decoded += missing.len();
    }
    let mut values = Vec::with_capacity(frames.len() * width);
    for key in &keys {
        let row = rows.get(key);
        values.extend(row.context("a frame changed while it was read")?);
    }
    Ok((values, frames_decoded))
}

/// The rows of the given frames. A photograph is called after its surface and its view, as a dataset's folder
/// has it; where the file names none, it has all frames, in the order of surfaces and their views.
fn of_file(source: &dyn Source, frames: &[FrameIndex], rows: &Precomputed) -> Result<Vec<f32>> {
    let surfaces = source.surfaces();
    let name = |frame: &FrameIndex| format!("{}/{:03}", surfaces[frame.surface].id, frame.view);
    if !rows.files().is_empty() {
        return Ok(rows.rows_of(&frames.iter().map(name).collect::<Vec<_>>())?);
    }
    let views = source.view_angles().len();
    let (found, expected) = (rows.rows(), surfaces.len() * views);
    ensure!(
        found == expected,
        "the file of embeddings names no `files` and has {found} rows, expected {expected}: {views} for each of \
         {} surfaces",
        surfaces.len()
    );
    let row = |frame: &FrameIndex| {
        let row = frame.surface * views + frame.view;
        &rows.values()[row * rows.width()..][..rows.width()]
    };
    Ok(frames.iter().flat_map(row).copied().collect())
}

type Wanted = (FrameKey, FrameIndex);

fn once_each(frames: &[FrameIndex], keys: &[FrameKey]) -> Vec<Wanted> {
    let mut seen = HashSet::new();
    frames
        .iter()
        .zip(keys)
        .filter(|(_, key)| seen.insert(**key))
        .map(|(&frame, &key)| (key, frame))
        .collect()
}

/// The blocks in which so many frames are encoded: one, unless other shards help.
fn blocks(work: Work, frames: usize) -> Vec<Range<usize>> {
    let Work::Shard(shard) = work else {
        return iter::once(0..frames).collect();
    };
    let order = shard.order(frames.div_ceil(BLOCK)).into_iter();
    let block = |place| place * BLOCK..frames.min((place + 1) * BLOCK);
    order.map(block).collect()
}

fn encode_missing(
    source: &dyn Source,
    missing: &[Wanted],
    embedder: &Embedder,
    cache: &EmbeddingCache,
    rows: &mut HashMap<FrameKey, Vec<f32>>,
) -> Result<()> {
    let progress = Progress::new("frames encoded", missing.len());
    let mut frames = decode_some(source, missing, embedder.resize(), BYTES_AT_ONCE)?;
    let mut missing = missing;
    while !frames.is_empty() {
        let (chunk, rest) = missing.split_at(frames.len());
        let (encoded, next) = rayon::join(
            || embedder.embed(&frames),
            || decode_some(source, rest, embedder.resize(), BYTES_AT_ONCE),
        );
        let values = encoded?;
        let keys: Vec<FrameKey> = chunk.iter().map(|(key, ..)| *key).collect();
        let new = keys.iter().zip(values.chunks_exact(embedder.width()));
        rows.extend(new.map(|(key, row)| (*key, row.to_vec())));
        cache.put(&Segment { keys, values })?;
        progress.advance(chunk.len());
        ensure_wanted()?;
        (frames, missing) = (next?, rest);
    }
    Ok(())
}

/// Decodes the first of the frames: those that so many bytes hold, at least one where there is one.
fn decode_some(
    source: &dyn Source,
    wanted: &[Wanted],
    shorter_side: Option<usize>,
    room: usize,
) -> Result<Vec<Frame>> {
    let decode =
        |(_, frame): &Wanted| source.frame_to_resize(frame.surface, frame.view, shorter_side);
    let bytes = |frame: &Frame| size_of_val(&frame.data[..]);
    let Some((first, others)) = wanted.split_first() else {
        return Ok(Vec::new());
    };
    let first = decode(first)?;
    // Frames of one source are mostly of one size; where they are not, what is held stops more.
    let most = (room / bytes(&first).max(1)).clamp(1, FRAMES_AT_ONCE);
    let held = AtomicUsize::new(bytes(&first));
    let others = others[..others.len().min(most - 1)].iter().enumerate();
    // Handed out in their order and only while there is room, so that none is decoded in vain.
    let decoded = others
        .take_while(|_| held.load(Ordering::Relaxed) < room)
        .par_bridge()
        .map(|(at, wanted)| {
            let frame = decode(wanted)?;
            held.fetch_add(bytes(&frame), Ordering::Relaxed);
            Ok((at, frame))
        });
    let mut decoded = decoded.collect::<Result<Vec<_>>>()?;
    decoded.sort_unstable_by_key(|(at, _)| *at);
    let others = decoded.into_iter().map(|(_, frame)| frame);
    Ok(iter::once(first).chain(others).collect())
}

#[cfg(test)]
mod tests;
