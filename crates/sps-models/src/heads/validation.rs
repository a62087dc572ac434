//! How good the networks of a stack are on surfaces that they are not trained on.

use candle_core::{Device, Tensor};
use sps_base::streams::named_stream;
use sps_regress::{TrainingData, Views};

use super::config::{EarlyStopping, HeadConfig};
use super::job::Job;
use super::network::Network;
use crate::error::Result;

/// Surfaces that are estimated at once.
const ROWS: usize = 32;

/// The validation parts of a stack's trials.
pub(super) struct Validation<'a> {
    config: &'a HeadConfig,
    early_stopping: EarlyStopping,
    data: &'a TrainingData<'a>,
    jobs: &'a [&'a Job<'a>],
    /// By trial and surface, where the trial's views are random: the same in every epoch, so that
    /// epochs differ by their weights alone. Empty where they are not.
    drawn: Vec<Vec<Vec<usize>>>,
}

impl<'a> Validation<'a> {
    /// `None` without early stopping.
    pub(super) fn new(
        config: &'a HeadConfig,
        data: &'a TrainingData<'a>,
        seed: u64,
        jobs: &'a [&'a Job<'a>],
    ) -> Option<Self> {
        let early_stopping = config.early_stopping?;
        let drawn = jobs.iter().map(|job| {
            if job.trial.views != Views::Random {
                return Vec::new();
            }
            let purpose = format!("validation-views/{}", job.trial.property);
            let mut rng = named_stream(seed, &purpose, job.trial.rerun);
            let surfaces = 0..job.validation.len();
            let draw = |_| config.input.draw(data.embeddings.views(), &mut rng);
            surfaces.map(draw).collect()
        });
        Some(Self {
            config,
            early_stopping,
            data,
            jobs,
            drawn: drawn.collect(),
        })
    }

    pub(super) fn patience(&self) -> usize {
        self.early_stopping.patience
    }

    /// The `L_est` of the training mean, which is zero in standardised units, by trial.
    pub(super) fn errors_of_the_mean(&self) -> Vec<f64> {
        let error = |job: &&Job<'_>| {
            let readings = job.validation.tactile.iter().flatten();
            mean_of_squares(readings.map(|&reading| f64::from(reading)))
        };
        self.jobs.iter().map(error).collect()
    }

    /// The `L_est` of the networks as they are, by trial.
    pub(super) fn errors(&self, network: &Network) -> Result<Vec<f64>> {
        let mut estimates = vec![Vec::new(); self.jobs.len()];
        let all = self.jobs.first().map_or(0, |job| job.validation.len());
        for start in (0..all).step_by(ROWS) {
            let rows = start..(start + ROWS).min(all);
            let values = network.estimate(&self.visual(rows.clone())?)?;
            let values = values.flatten_all()?.to_vec1::<f32>()?;
            for (own, values) in estimates.iter_mut().zip(values.chunks_exact(rows.len())) {
                own.extend_from_slice(values);
            }
        }
        let error = |(job, estimates): (&&Job<'_>, Vec<f32>)| {
            let pairs = job.validation.tactile.iter().zip(estimates);
            let error = |(reading, estimate): (&Option<f32>, f32)| {
                Some(f64::from(estimate) - f64::from((*reading)?))
            };
            mean_of_squares(pairs.filter_map(error))
        };
        Ok(self.jobs.iter().zip(estimates).map(error).collect())
    }

    /// `(trials, rows, slots x width)`.
    fn visual(&self, rows: std::ops::Range<usize>) -> Result<Tensor> {
        let (input, embeddings) = (&self.config.input, self.data.embeddings);
        let inputs = input.slots() * embeddings.width();
        let shape = (self.jobs.len(), rows.len(), inputs);
        let mut visual = Vec::with_capacity(shape.0 * shape.1 * shape.2);
        for (job, drawn) in self.jobs.iter().zip(&self.drawn) {
            for row in rows.clone() {
                let surface = job.validation.surfaces[row];
                let views = match &job.trial.views {
                    Views::Fixed(views) => views,
                    Views::Steps(steps) => &steps[row % steps.len()],
                    Views::Random => &drawn[row],
                };
                let seen = &job.statistics;
                seen.push_seen(input, embeddings, surface, views, &mut visual);
            }
        }
        Ok(Tensor::from_vec(visual, shape, &Device::Cpu)?)
    }
}

/// The largest number there is where a square is not finite: worse than any, and files can hold it.
fn mean_of_squares(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for value in values {
        sum += value * value;
        count += 1.0;
    }
    (sum / count.max(1.0)).min(f64::MAX)
}
