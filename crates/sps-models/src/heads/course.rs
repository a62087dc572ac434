//! How the training of one trial goes, apart from those that are trained beside it.

use sps_regress::DivergedTrial;

use super::job::Job;
use super::network::Dims;
use super::train::Outcome;
use super::trained::{EpochLosses, KeptEpoch, TrainedHead};
use super::validation::Validation;
use crate::error::Result;
use crate::weights::Weights;

/// The losses of a trial so far, whether it goes on, and what is kept of it.
pub(super) struct Course {
    history: Vec<EpochLosses>,
    state: State,
    /// Under early stopping.
    best: Option<Best>,
}

enum State {
    Running,
    Stopped,
    /// Why it is of no use.
    Diverged(String),
}

/// The best epoch so far.
struct Best {
    kept: KeptEpoch,
    /// `None` for the training mean.
    parameters: Option<Weights>,
}

impl Course {
    /// One for each of the jobs.
    pub(super) fn start(jobs: &[&Job<'_>], validation: Option<&Validation<'_>>) -> Vec<Self> {
        let means = validation.map(Validation::errors_of_the_mean);
        let course = |(at, job): (usize, &&Job<'_>)| Self {
            history: Vec::new(),
            state: match job.target.mean + job.target.std {
                spread if spread.is_finite() => State::Running,
                _ => State::Diverged("the readings' mean or spread leaves f64".into()),
            },
            best: means.as_ref().map(|means| Best {
                kept: KeptEpoch {
                    epoch: 0,
                    errors: vec![means[at]],
                },
                parameters: None,
            }),
        };
        jobs.iter().enumerate().map(course).collect()
    }

    pub(super) fn has_ended(&self) -> bool {
        !matches!(self.state, State::Running)
    }

    /// The losses of one more epoch.
    pub(super) fn record(&mut self, losses: EpochLosses) {
        if self.has_ended() {
            return;
        }
        self.history.push(losses);
        if let Some(loss) = losses.all().into_iter().find(|loss| !loss.is_finite()) {
            let epoch = self.history.len();
            self.state = State::Diverged(format!("the loss is {loss} in epoch {epoch}"));
        }
    }

    /// The error on the validation part after the epoch that was recorded last; `parameters`
    /// copies the trial's weights, when they are the best so far.
    pub(super) fn validate(
        &mut self,
        patience: usize,
        error: f64,
        parameters: impl FnOnce() -> Result<Weights>,
    ) -> Result<()> {
        if self.has_ended() {
            return Ok(());
        }
        let Some(best) = &mut self.best else {
            return Ok(());
        };
        let kept = &mut best.kept;
        let epoch = kept.errors.len();
        if error < kept.errors[kept.epoch] {
            kept.epoch = epoch;
            best.parameters = Some(parameters()?);
        }
        kept.errors.push(error);
        if patience > 0 && epoch - kept.epoch >= patience {
            self.state = State::Stopped;
        }
        Ok(())
    }

    /// What became of the trial; `last` are its weights after the last epoch.
    pub(super) fn end(self, job: &Job<'_>, dims: Dims, last: Weights) -> Result<Outcome> {
        let trial = job.trial.clone();
        let (parameters, kept) = match (self.state, self.best) {
            (State::Diverged(reason), _) => return Ok(Err(DivergedTrial { trial, reason })),
            (_, None) => (last, None),
            (_, Some(best)) => {
                let parameters = best.parameters.map_or_else(|| mean(&last), Ok);
                (parameters?, Some(best.kept))
            }
        };
        for (name, tensor) in parameters.iter() {
            let values = tensor.flatten_all()?.to_vec1::<f32>()?;
            if let Some(value) = values.iter().find(|value| !value.is_finite()) {
                let reason = format!("{name} holds {value} after the last epoch");
                return Ok(Err(DivergedTrial { trial, reason }));
            }
        }
        Ok(Ok(TrainedHead {
            trial,
            dims,
            statistics: job.statistics.as_ref().clone(),
            target: job.target,
            parameters,
            history: self.history,
            kept,
        }))
    }
}

/// The network that says 0, the training mean in standardised units, to everything: all of its
/// weights are 0.
fn mean(like: &Weights) -> Result<Weights> {
    let zeros = like.iter();
    let zeros = zeros.map(|(name, tensor)| Ok((name.to_owned(), tensor.zeros_like()?)));
    let zeros = zeros.collect::<Result<Vec<_>>>()?;
    Ok(Weights::sharing(like.origin(), zeros))
}
