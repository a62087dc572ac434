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
                tactile.push(job.training.tactile[at]);
                labels.push(job.labels.as_ref().and_then(|labels| labels.of[at]));
            }
        }
        self.step += 1;
        let counts = rows_that_count(&tactile, rows);
        let labelled = rows_that_count(&labels, rows);
        let visual = Tensor::from_vec(visual, (trials, rows, inputs), &Device::Cpu)?;
        let batch = Batch::new(visual, width, (&tactile, &counts), (labels, &labelled))?;
        Ok((batch, counts))
    }
}

/// For each trial, how many of its rows there is something of.
pub(super) fn rows_that_count<T>(values: &[Option<T>], rows: usize) -> Vec<f64> {
    let trials = values.chunks(rows.max(1));
    let number = |trial: &[Option<T>]| trial.iter().flatten().count() as f64;
    trials.map(number).collect()
}
