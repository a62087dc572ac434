//! The training loop of one stack.

use sps_regress::{DivergedTrial, TrainingData};

use super::Observer;
use super::batches::Batches;
use super::config::HeadConfig;
use super::course::Course;
use super::job::Job;
use super::losses::Losses;
use super::network::{Network, is_discriminator};
use super::stack::{Stack, StackParameter};
use super::trained::{EpochLosses, TrainedHead};
use super::validation::Validation;
use crate::error::{Error, Result};
use crate::optim::{Adam, clip_scales, squared_norms};

/// What became of a trial.
pub(super) type Outcome = std::result::Result<TrainedHead, DivergedTrial>;

/// Trains the jobs together, one stacked network for all; the outcomes are in their order.
///
/// A trial that has diverged or stopped early stays in the stack until all have: what it computes
/// from there on reaches no other trial, and is not looked at.
pub(super) fn train_stack(
    config: &HeadConfig,
    data: &TrainingData<'_>,
    seed: u64,
    jobs: &[&Job<'_>],
    observer: &dyn Observer,
) -> Result<Vec<Outcome>> {
    let Some(first) = jobs.first() else {
        return Ok(Vec::new());
    };
    let dims = first.dims(config, data.embeddings);
    let stack = Stack::drawn(config, dims, seed, jobs)?;
    let network = &stack.network;
    let mut sides = Side::of(config, &stack.parameters, jobs.len())?;
    let mut batches = Batches::new(config, data, seed, jobs);
    let validation = Validation::new(config, data, seed, jobs);
    let mut courses = Course::start(jobs, validation.as_ref());
    for epoch in 0..config.epochs {
        if observer.stops() {
            return Err(Error::Stopped);
        }
        batches.shuffle(epoch);
        let losses = pass(config, network, &mut batches, &mut sides)?;
        let losses = courses.iter_mut().zip(losses);
        losses.for_each(|(course, losses)| course.record(losses));
        if let Some(validation) = &validation {
            let errors = validation.errors(network)?;
            for (at, (course, error)) in courses.iter_mut().zip(errors).enumerate() {
                course.validate(validation.patience(), error, || stack.of_trial(at))?;
            }
        }
        if courses.iter().all(Course::has_ended) {
            break;
        }
    }
    let ends = jobs.iter().zip(courses).enumerate();
    ends.map(|(at, (job, course))| course.end(job, dims, stack.of_trial(at)?))
        .collect()
}

/// One pass over the training surfaces, and the mean of each trial's losses over it.
fn pass(
    config: &HeadConfig,
    network: &Network,
    batches: &mut Batches<'_>,
    sides: &mut [Side],
) -> Result<Vec<EpochLosses>> {
    let mut sums = vec![EpochLosses::default(); batches.trials()];
    let mut totals = vec![0.0_f64; batches.trials()];
    for start in (0..batches.rows()).step_by(config.batch_size) {
        let (batch, counts) = batches.at(start)?;
        let losses = Losses::of(network, &batch)?;
        for (total, count) in totals.iter_mut().zip(&counts) {
            *total += count;
        }
        for (field, term) in losses.terms() {
            let values = term.to_vec1::<f32>()?;
            for ((sum, value), count) in sums.iter_mut().zip(values).zip(&counts) {
                *field(sum) += f64::from(value) * count;
            }
        }
        sides.iter().for_each(Side::clear);
        losses.total(&config.model)?.backward()?;
        for side in &mut *sides {
            side.step(config)?;
        }
    }
    let sums = sums.into_iter().zip(totals);
    let means = sums.map(|(sum, total)| sum.scaled(1.0 / total.max(1.0)));
    Ok(means.collect())
}

/// One side of the adversarial game with its optimiser; without a game there is one side.
struct Side {
    parameters: Vec<StackParameter>,
    trials: usize,
    adam: Adam,
}

impl Side {
    fn of(config: &HeadConfig, parameters: &[StackParameter], trials: usize) -> Result<Vec<Self>> {
        let parameters = parameters.iter().cloned();
        let (against, with): (Vec<_>, Vec<_>) = parameters.partition(|p| is_discriminator(&p.name));
        let side = |parameters: Vec<StackParameter>| {
            let variables = parameters.iter().map(|one| one.variable.clone());
            Ok(Self {
                adam: Adam::new(config.adam.clone(), variables)?,
                parameters,
                trials,
            })
        };
        let sides = [with, against].into_iter();
        sides.filter(|side| !side.is_empty()).map(side).collect()
    }

    fn clear(&self) {
        self.parameters.iter().for_each(|p| p.gradient.clear());
    }

    fn step(&mut self, config: &HeadConfig) -> Result<()> {
        let mut scales = Vec::new();
        if let Some(largest) = config.clip_norm {
            let mut squares = vec![0.0; self.trials];
            for parameter in &self.parameters {
                squared_norms(parameter, &mut squares)?;
            }
            scales = clip_scales(&squares, largest);
        }
        self.adam.step(&self.parameters, &scales)
    }
}
