//! From frames to embeddings, at most once per frame.

mod cache;
mod embedder;
mod resample;
mod segment;

use std::collections::{HashMap, HashSet};

use anyhow::{Context, Result};
use rayon::prelude::*;
use sps_dataset::{Frame, FrameIndex, FrameKey, Source};

pub(crate) use cache::EmbeddingCache;
pub(crate) use embedder::{Embedder, prepare};
use segment::Segment;

use crate::progress::Progress;

/// Frames decoded ahead while as many are encoded.
const FRAMES_AT_ONCE: usize = 32;

/// Embeddings of some frames.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Embeddings {
    pub width: usize,
    /// (frames, width), row-major.
    pub values: Vec<f32>,
    /// Frames that had to be decoded or rendered, because the cache did not have them.
    pub frames_decoded: usize,
}

/// Embeds the given frames of `source`, decoding only what `cache` lacks.
pub(crate) fn embed<S: Source>(
    source: &S,
    frames: &[FrameIndex],
    embedder: &Embedder,
    cache: &EmbeddingCache,
) -> Result<Embeddings> {
    let keys = frames
        .par_iter()
        .map(|frame| source.frame_key(frame.surface, frame.view))
        .collect::<Result<Vec<FrameKey>, _>>()?;
    let mut rows = cache.get(&keys.iter().copied().collect())?;
    let missing = missing(frames, &keys, &rows);
    encode_missing(source, &missing, embedder, cache, &mut rows)?;
    let mut values = Vec::with_capacity(frames.len() * embedder.width());
    for key in &keys {
        let row = rows.get(key);
        values.extend(row.context("a frame changed while it was read")?);
    }
    Ok(Embeddings {
        width: embedder.width(),
        values,
        frames_decoded: missing.len(),
    })
}

/// A frame to encode.
type Wanted = (FrameKey, FrameIndex);

fn missing(
    frames: &[FrameIndex],
    keys: &[FrameKey],
    cached: &HashMap<FrameKey, Vec<f32>>,
) -> Vec<Wanted> {
    let mut seen = HashSet::new();
    frames
        .iter()
        .zip(keys)
        .filter(|(_, key)| !cached.contains_key(*key) && seen.insert(**key))
        .map(|(&frame, &key)| (key, frame))
        .collect()
}

fn encode_missing<S: Source>(
    source: &S,
    missing: &[Wanted],
    embedder: &Embedder,
    cache: &EmbeddingCache,
    rows: &mut HashMap<FrameKey, Vec<f32>>,
) -> Result<()> {
    let decode = |chunk: &[Wanted]| -> Result<Vec<Frame>> {
        let frames = chunk
            .par_iter()
            .map(|(_, frame)| source.frame(frame.surface, frame.view));
        Ok(frames.collect::<Result<_, _>>()?)
    };
    let progress = Progress::new("frames encoded", missing.len());
    let chunks: Vec<&[Wanted]> = missing.chunks(FRAMES_AT_ONCE).collect();
    let mut ready = chunks.first().map(|chunk| decode(chunk)).transpose()?;
    for (index, chunk) in chunks.iter().enumerate() {
        let Some(frames) = ready.take() else { break };
        let (encoded, next) = rayon::join(
            || embedder.embed(&frames),
            || chunks.get(index + 1).map(|chunk| decode(chunk)).transpose(),
        );
        let values = encoded?;
        let keys: Vec<FrameKey> = chunk.iter().map(|(key, ..)| *key).collect();
        let width = embedder.width();
        rows.extend(
            keys.iter()
                .zip(values.chunks_exact(width))
                .map(|(key, row)| (*key, row.to_vec())),
        );
        cache.put(&Segment { keys, values })?;
        progress.advance(chunk.len());
        ready = next?;
    }
    Ok(())
}
