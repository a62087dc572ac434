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
            let mut mean = Mean::default();
            let readings = job.validation.tactile.iter().flatten();
            readings.for_each(|&t| mean.add(f64::from(t)));
            mean.of_squares()
        };
        self.jobs.iter().map(error).collect()
    }

    /// The `L_est` of the networks as they are, by trial.
    pub(super) fn errors(&self, network: &Network) -> Result<Vec<f64>> {
        let mut means = vec![Mean::default(); self.jobs.len()];
        let all = self.jobs.first().map_or(0, |job| job.validation.len());
        for start in (0..all).step_by(ROWS) {
            let rows = start..(start + ROWS).min(all);
            let values = network.estimate(&self.visual(rows.clone())?)?;
            let values = values.flatten_all()?.to_vec1::<f32>()?;
            let trials = self.jobs.iter().zip(values.chunks_exact(rows.len()));
            for ((job, values), mean) in trials.zip(&mut means) {
                let readings = &job.validation.tactile[rows.clone()];
                for (value, reading) in values.iter().zip(readings) {
                    if let Some(reading) = reading {
                        mean.add(f64::from(*value) - f64::from(*reading));
                    }
                }
            }
        }
        Ok(means.into_iter().map(Mean::of_squares).collect())
    }

    /// `(trials, rows, slots x width)`.
    fn visual(&self, rows: std::ops::Range<usize>) -> Result<Tensor> {
        let inputs = self.config.input.slots() * self.data.embeddings.width();
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
                job.push_visual(self.config, self.data, surface, views, &mut visual);
            }
        }
        Ok(Tensor::from_vec(visual, shape, &Device::Cpu)?)
    }
}

/// A mean of squares under way.
#[derive(Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value * value;
        self.count += 1.0;
    }

    /// The largest number there is for none: worse than any, and files can hold it.
    fn of_squares(self) -> f64 {
        (self.sum / self.count.max(1.0)).min(f64::MAX)
    }
}
