//! One estimate of one surface, and what it took.

use std::collections::BTreeSet;
use std::time::Instant;

use anyhow::Result;
use sps_dataset::{Frame, Source};
use sps_estimator::Network;
use sps_regress::{Embeddings, FittedRegressor};

use crate::memory;
use crate::results::Costs;
use crate::run::Stage;

/// What estimates are made of.
pub(super) struct Estimating<'a, S> {
    pub source: &'a S,
    pub stage: &'a Stage,
}

/// What one estimate took.
#[derive(Clone, Copy, Default)]
pub(super) struct Spent {
    decode: f64,
    encode: f64,
    head: f64,
    /// Decoded and encoded.
    frames: usize,
    multiply_adds: Option<u64>,
    /// Bytes allocated at most, beside what was there before.
    memory: usize,
}

impl<S: Source> Estimating<'_, S> {
    /// Estimates one surface.
    pub(super) fn estimate(
        &self,
        model: &dyn FittedRegressor,
        fillings: &[Vec<usize>],
        surface: usize,
    ) -> Result<Spent> {
        let (spent, memory) = memory::peak(|| {
            let views: BTreeSet<usize> = fillings.iter().flatten().copied().collect();
            let views: Vec<usize> = views.into_iter().collect();
            let of_heads = fillings.len() as u64 * model.multiply_adds();
            self.look(surface, &views, of_heads, |values| {
                let embeddings = self.embeddings(&values)?;
                for filling in fillings {
                    let slots = filling
                        .iter()
                        .filter_map(|view| views.binary_search(view).ok());
                    let slots: Vec<usize> = slots.collect();
                    model.predict(&embeddings.select(&[0], &slots)?)?;
                }
                Ok(())
            })
        });
        Ok(Spent { memory, ..spent? })
    }

    /// What has been spent after each view.
    pub(super) fn walk(
        &self,
        models: &[[Box<dyn FittedRegressor>; 2]],
        order: &[usize],
        surface: usize,
    ) -> Result<Vec<Spent>> {
        let mut values = Vec::new();
        let mut sum = Spent {
            multiply_adds: Some(0),
            ..Spent::default()
        };
        let mut all = Vec::new();
        for (models, &view) in models.iter().zip(order) {
            let of_heads = models.iter().map(|model| model.multiply_adds());
            let of_heads = of_heads.sum();
            let (step, memory) = memory::peak(|| {
                self.look(surface, &[view], of_heads, |embedding| {
                    values.extend(embedding);
                    let embeddings = self.embeddings(&values)?;
                    for model in models {
                        model.predict(&embeddings)?;
                    }
                    Ok(())
                })
            });
            sum = sum.and(&Spent { memory, ..step? });
            all.push(sum);
        }
        Ok(all)
    }

    /// Decodes and encodes some views of a surface, where no file has their embeddings, and lets `ask` ask
    /// models about the embeddings, which takes so many multiply-adds.
    fn look(
        &self,
        surface: usize,
        views: &[usize],
        of_heads: u64,
        ask: impl FnOnce(Vec<f32>) -> Result<()>,
    ) -> Result<Spent> {
        let Stage {
            embedder, tables, ..
        } = self.stage;
        if let Network::Precomputed(_) = embedder.network() {
            // What a surface that is only scored on takes is what any other takes.
            let surface = surface.min(tables.pool() - 1);
            let rows = views
                .iter()
                .map(|&view| tables.embeddings.get(surface, view));
            let values = rows.flatten().flatten().copied().collect();
            return Ok(Spent {
                head: timed(|| ask(values))?.1,
                multiply_adds: Some(of_heads),
                ..Spent::default()
            });
        }
        let (frames, decode) = timed(|| {
            let views = views.iter().map(|&view| tables.views[view]);
            let size = embedder.resize();
            let frames = views.map(|view| self.source.frame_to_resize(surface, view, size));
            Ok(frames.collect::<Result<Vec<Frame>, _>>()?)
        })?;
        let (values, encode) = timed(|| Ok(embedder.embed(&frames)?))?;
        let ((), head) = timed(|| ask(values))?;
        let of_encoder = frames.iter().map(|frame| embedder.multiply_adds(frame));
        Ok(Spent {
            decode,
            encode,
            head,
            frames: embedder.network().frames() * frames.len(),
            multiply_adds: of_encoder.sum::<Option<u64>>().map(|sum| sum + of_heads),
            memory: 0,
        })
    }

    /// Embeddings of one surface.
    fn embeddings(&self, values: &[f32]) -> Result<Embeddings> {
        let embedder = &self.stage.embedder;
        Ok(embedder.table(values, 1, values.len() / embedder.width())?)
    }
}

impl Spent {
    /// This, then `next`.
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
    let multiply_adds = multiply_adds
        .sum::<Option<u64>>()
        .filter(|_| !all.is_empty());
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
