//! One estimate of one surface, and what it took.

use std::time::Instant;

use anyhow::Result;
use sps_base::memory;
use sps_dataset::{Frame, Source};
use sps_estimator::Network;
use sps_regress::FittedRegressor;

use crate::results::Costs;
use crate::run::Stage;

/// A look at more of the views of a surface, after which models are asked.
pub(super) struct Look {
    /// Those that were not looked at before.
    pub views: Vec<usize>,
    pub models: Vec<Box<dyn FittedRegressor>>,
    /// What each of them is asked about: of the views so far, by their places.
    pub fillings: Vec<Vec<usize>>,
}

#[derive(Clone, Copy, Default)]
pub(super) struct Spent {
    /// Seconds.
    decode: f64,
    encode: f64,
    /// On asking models.
    head: f64,
    /// Decoded and encoded.
    frames: usize,
    multiply_adds: Option<u64>,
    /// Bytes allocated at most, beside what was there before.
    memory: usize,
}

/// What has been spent on a surface after each look.
pub(super) fn estimate(
    source: &dyn Source,
    stage: &Stage,
    looks: &[Look],
    surface: usize,
) -> Result<Vec<Spent>> {
    let mut values = Vec::new();
    let mut sum = Spent {
        multiply_adds: Some(0),
        ..Spent::default()
    };
    let looks = looks.iter().map(|look| {
        let (spent, memory) = memory::peak(|| look.take(source, stage, surface, &mut values));
        sum = sum.and(&Spent { memory, ..spent? });
        Ok(sum)
    });
    looks.collect()
}

impl Look {
    /// Decodes and encodes the views, where no file has their embeddings, and asks; `values` are the
    /// embeddings so far.
    fn take(
        &self,
        source: &dyn Source,
        stage: &Stage,
        surface: usize,
        values: &mut Vec<f32>,
    ) -> Result<Spent> {
        let Stage {
            embedder, tables, ..
        } = stage;
        let (mut frames, mut decode, mut encode) = (Vec::new(), 0.0, 0.0);
        if let Network::Precomputed(_) = embedder.network() {
            // What a surface that is only scored on takes is what any other takes.
            let surface = surface.min(tables.pool() - 1);
            let rows = self.views.iter();
            let rows = rows.filter_map(|&view| tables.embeddings.get(surface, view));
            values.extend(rows.flatten());
        } else {
            (frames, decode) = timed(|| {
                let views = self.views.iter().map(|&view| tables.views[view]);
                let size = embedder.resize();
                let frames = views.map(|view| source.frame_to_resize(surface, view, size));
                Ok(frames.collect::<Result<Vec<Frame>, _>>()?)
            })?;
            let embedded;
            (embedded, encode) = timed(|| Ok(embedder.embed(&frames)?))?;
            values.extend(embedded);
        }
        let ((), head) = timed(|| self.ask(stage, values))?;
        let of_encoder = frames.iter().map(|frame| embedder.multiply_adds(frame));
        let of_models = self.models.iter().map(|model| model.multiply_adds());
        let of_models = self.fillings.len() as u64 * of_models.sum::<u64>();
        Ok(Spent {
            decode,
            encode,
            head,
            frames: embedder.network().frames() * frames.len(),
            multiply_adds: of_encoder.sum::<Option<u64>>().map(|sum| sum + of_models),
            memory: 0,
        })
    }

    fn ask(&self, stage: &Stage, values: &[f32]) -> Result<()> {
        let views = values.len() / stage.embedder.width();
        let embeddings = stage.embedder.table(values, 1, views)?;
        for filling in &self.fillings {
            let asked = embeddings.select(&[0], filling)?;
            for model in &self.models {
                model.predict(&asked)?;
            }
        }
        Ok(())
    }
}

impl Spent {
    fn and(&self, next: &Self) -> Self {
        let counts = self.multiply_adds.zip(next.multiply_adds);
        Self {
            decode: self.decode + next.decode,
            encode: self.encode + next.encode,
            head: self.head + next.head,
            frames: self.frames + next.frames,
            multiply_adds: counts.map(|(sum, next)| sum + next),
            memory: self.memory.max(next.memory),
        }
    }
}

/// Medians of the seconds, means of the counts, and the most memory, with that of the encoder.
pub(super) fn costs(all: &[Spent], encoder_bytes: usize) -> Costs {
    let count = all.len().max(1) as f64;
    let frames = all.iter().map(|spent| spent.frames).sum::<usize>() as f64 / count;
    let multiply_adds = all.iter().map(|spent| spent.multiply_adds);
    let multiply_adds: Option<u64> = multiply_adds.sum();
    let multiply_adds = multiply_adds.filter(|_| !all.is_empty());
    let memory = all.iter().map(|spent| spent.memory).max();
    Costs {
        frames_decoded_per_surface: frames,
        frames_encoded_per_surface: frames,
        predict_seconds_per_surface: median(all, |spent| spent.decode + spent.encode + spent.head),
        decode_seconds_per_surface: median(all, |spent| spent.decode),
        encode_seconds_per_surface: median(all, |spent| spent.encode),
        head_seconds_per_surface: median(all, |spent| spent.head),
        peak_memory_bytes: memory.map(|bytes| (bytes + encoder_bytes) as f64),
        multiply_adds_per_surface: multiply_adds.map(|sum| sum as f64 / count),
        ..Costs::default()
    }
}

fn median(all: &[Spent], of: fn(&Spent) -> f64) -> Option<f64> {
    let mut values: Vec<f64> = all.iter().map(of).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// What `work` gives, and its seconds.
pub(super) fn timed<T>(work: impl FnOnce() -> Result<T>) -> Result<(T, f64)> {
    let start = Instant::now();
    let done = work()?;
    Ok((done, start.elapsed().as_secs_f64()))
}
