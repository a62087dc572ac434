//! The mini-batches of a stack.

use candle_core::{Device, Tensor};
use rand::seq::SliceRandom;
use sps_base::streams::{ChaCha8Rng, named_stream};
use sps_regress::{TrainingData, Views};

use super::config::HeadConfig;
use super::job::Job;
use super::losses::Batch;
use crate::error::Result;

/// The mini-batches of a stack. Trials of one rerun go through the same surfaces in the same order.
pub(super) struct Batches<'a> {
    config: &'a HeadConfig,
    data: &'a TrainingData<'a>,
    seed: u64,
    jobs: &'a [&'a Job<'a>],
    /// Positions among the training surfaces, by trial.
    orders: Vec<Vec<usize>>,
    /// Draws the views of trials that have no fixed ones.
    views: Vec<ChaCha8Rng>,
    /// Batches given so far.
    step: usize,
}

impl<'a> Batches<'a> {
    pub(super) fn new(
        config: &'a HeadConfig,
        data: &'a TrainingData<'a>,
        seed: u64,
        jobs: &'a [&'a Job<'a>],
    ) -> Self {
        let views = jobs.iter().map(|job| {
            let purpose = format!("views/{}", job.trial.property);
            named_stream(seed, &purpose, job.trial.rerun)
        });
        Self {
            config,
            data,
            seed,
            jobs,
            orders: vec![Vec::new(); jobs.len()],
            views: views.collect(),
            step: 0,
        }
    }

    pub(super) fn trials(&self) -> usize {
        self.jobs.len()
    }

    pub(super) fn rows(&self) -> usize {
        self.orders.first().map_or(0, Vec::len)
    }

    pub(super) fn shuffle(&mut self, epoch: usize) {
        for (order, job) in self.orders.iter_mut().zip(self.jobs) {
            let purpose = format!("order/{}", job.trial.rerun);
            order.clear();
            order.extend(0..job.training.len());
            order.shuffle(&mut named_stream(self.seed, &purpose, epoch as u64));
        }
    }

    /// The batch from `start` on, and how many readings each trial has in it.
    pub(super) fn at(&mut self, start: usize) -> Result<(Batch, Vec<f64>)> {
        let end = (start + self.config.batch_size).min(self.rows());
        let (trials, rows) = (self.jobs.len(), end - start);
        let (input, embeddings) = (&self.config.input, self.data.embeddings);
        let width = embeddings.width();
        let inputs = input.slots() * width;
        let mut visual = Vec::with_capacity(trials * rows * inputs);
        let mut tactile = Vec::with_capacity(trials * rows);
        let mut measured = Vec::with_capacity(trials * rows);
        let mut labels = Vec::with_capacity(trials * rows);
        for ((job, order), rng) in self.jobs.iter().zip(&self.orders).zip(&mut self.views) {
            for &at in &order[start..end] {
                let drawn;
                let views = match &job.trial.views {
                    Views::Fixed(views) => views,
                    Views::Steps(steps) => &steps[self.step % steps.len()],
                    Views::Random => {
                        drawn = input.draw(embeddings.views(), rng);
                        &drawn
                    }
                };
                let (seen, surface) = (&job.statistics, job.training.surfaces[at]);
                seen.push_seen(input, embeddings, surface, views, &mut visual);
                tactile.push(job.training.tactile[at].unwrap_or(0.0));
                measured.push(job.training.tactile[at].is_some());
                labels.push(job.labels.as_ref().and_then(|labels| labels.of[at]));
            }
        }
        let labelled: Vec<bool> = labels.iter().map(Option::is_some).collect();
        self.step += 1;
        let counts = rows_that_count(&measured, rows);
        let weight = mean_weights(&measured, &counts);
        let label_weight = mean_weights(&labelled, &rows_that_count(&labelled, rows));
        let cpu = &Device::Cpu;
        let batch = Batch {
            visual: Tensor::from_vec(visual, (trials, rows, inputs), cpu)?,
            width,
            tactile: Tensor::from_vec(tactile, (trials, rows, 1), cpu)?,
            weight: Tensor::from_vec(weight, (trials, rows), cpu)?,
            labels,
            label_weight: Tensor::from_vec(label_weight, (trials, rows), cpu)?,
        };
        Ok((batch, counts))
    }
}

/// For each trial, how many of its rows count.
pub(super) fn rows_that_count(counts: &[bool], rows: usize) -> Vec<f64> {
    let trials = counts.chunks(rows.max(1));
    let number = |trial: &[bool]| trial.iter().filter(|&&counts| counts).count() as f64;
    trials.map(number).collect()
}

/// For each trial, one over its number in each of the rows that count, and zero in the others.
pub(super) fn mean_weights(counts: &[bool], numbers: &[f64]) -> Vec<f32> {
    let rows = counts.len() / numbers.len().max(1);
    let trials = counts.chunks(rows.max(1)).zip(numbers);
    let weights = trials.flat_map(|(trial, &number)| {
        let weight = 1.0 / number.max(1.0) as f32;
        let of = move |&counts: &bool| if counts { weight } else { 0.0 };
        trial.iter().map(of)
    });
    weights.collect()
}
