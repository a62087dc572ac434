//! From an embedding to a tactile value: the regression baseline and the cross-modal network of
//! the paper's section 4.1.
//!
//! There is one network per property and rerun. All networks of a plan are trained together, a
//! stack at a time, and each has the bits that it would have alone, on any number of threads.
//!
//! ```
//! use candle_core::{DType, Device, Tensor};
//! use sps_models::embeddings_of;
//! use sps_models::heads::{Head, HeadConfig};
//! use sps_regress::{Plan, Readings, Rerun, TrainingData};
//!
//! // Six surfaces, one view of each; a reading that was not taken is `None`.
//! let embeddings = embeddings_of(&Tensor::eye(6, DType::F32, &Device::Cpu)?)?;
//! let readings = [Some(31.0), None, Some(55.0), Some(48.0), Some(40.0), None].map(|r| vec![r]);
//! let readings = Readings::new(vec!["friction".into()], &readings)?;
//! let data = TrainingData::new(&embeddings, &readings);
//! let rerun = Rerun::new(0, vec![0, 1, 2, 3]);
//! let plan = Plan::each(7, readings.properties(), vec![rerun]);
//!
//! let head = Head::new(HeadConfig { epochs: 2, ..HeadConfig::default() })?;
//! let trained = head.train(&data, &plan, &())?;
//! // Of surfaces 4 and 5, view 0: one list per property and rerun, in measured units.
//! let estimates = trained.predict(&embeddings.select(&[4, 5], &[0])?)?;
//! assert_eq!((estimates[0].property.as_str(), estimates[0].values.len()), ("friction", 2));
//! # Ok::<(), sps_models::Error>(())
//! ```

mod batches;
mod config;
mod course;
mod fusion;
mod input;
mod job;
mod joint;
mod losses;
mod network;
pub(crate) mod regressor;
mod stack;
mod store;
#[cfg(all(test, feature = "clusters"))]
mod tests;
mod train;
mod trained;
mod validation;

pub use config::{
    Adversarial, Classification, CrossModal, EarlyStopping, HeadConfig, Input, Model,
    RelationScale, Scale,
};
pub use fusion::FusionLoss;
pub(crate) use joint::{Draw, JointHeads, Share};
pub use trained::{EpochLosses, KeptEpoch, TrainedHead, TrainedHeads};

use sps_base::{Unexpected, parallel};
use sps_regress::{Error as RegressError, Plan, TrainingData, Views};

use crate::error::Result;

/// A checked configuration, ready to train.
#[derive(Clone, Debug, PartialEq)]
pub struct Head(HeadConfig);

/// Hears of the trials that a training has finished, and may stop it; calls come from several threads.
pub trait Observer: Sync {
    /// Whether nothing more is to be trained, for example because what is finished can no longer be
    /// kept; asked before every epoch. [`Head::train`] then ends with [`Error::Stopped`](crate::Error::Stopped).
    fn stops(&self) -> bool {
        false
    }

    /// Some of the plan's trials are trained or have diverged, in no particular order; those that
    /// never come here are what is missing after a run was stopped.
    fn finished(&self, heads: &TrainedHeads) {
        let _ = heads;
    }
}

/// Hears nothing.
impl Observer for () {}

impl Head {
    /// Checks a configuration.
    ///
    /// # Errors
    /// The first value that is out of its range, with its key.
    pub fn new(config: HeadConfig) -> Result<Self> {
        config.check()?;
        Ok(Self(config))
    }

    /// The configuration.
    pub fn config(&self) -> &HeadConfig {
        &self.0
    }

    /// Trains every trial of the plan, on the threads of the current rayon pool.
    ///
    /// A trial depends on the configuration, the data, the seed, its own property, rerun and
    /// views, and on nothing else: training a part of a plan gives the same bits. A trial whose
    /// loss is no longer finite is among [`TrainedHeads::diverged`], and the others have the bits
    /// that they have without it.
    ///
    /// # Errors
    /// A plan that does not fit the data, labels that cannot be formed, a property without a
    /// training reading, or under early stopping without one on the validation part; an observer
    /// that [stops](Observer::stops) it.
    pub fn train(
        &self,
        data: &TrainingData<'_>,
        plan: &Plan,
        observer: &dyn Observer,
    ) -> Result<TrainedHeads> {
        let random = plan.trials.iter().any(|trial| trial.views == Views::Random);
        if random && matches!(self.0.input, Input::Relations { .. }) {
            // Relations hold between views in order, which random ones are not.
            let expected = "those of each step";
            let views = Unexpected::new("views of relations", "random ones", expected);
            return Err(RegressError::Plan(views).into());
        }
        plan.check(self.0.input.views(), data)?;
        if self.0.early_stopping.is_some() {
            plan.check_validation(data)?;
        }
        let jobs = job::prepare(&self.0, data, plan)?;
        let stacks = job::stacks(&self.0, data, &jobs)?;
        let trained = parallel::map(&stacks, |stack| -> Result<Vec<_>> {
            let jobs: Vec<_> = stack.iter().map(|&index| &jobs[index]).collect();
            let outcomes = train::train_stack(&self.0, data, plan.seed, &jobs, observer)?;
            observer.finished(&self.trained(outcomes.iter().cloned()));
            Ok(stack.iter().copied().zip(outcomes).collect())
        });
        let mut outcomes = Vec::with_capacity(jobs.len());
        for stack in trained {
            outcomes.extend(stack?);
        }
        outcomes.sort_by_key(|&(index, _)| index);
        Ok(self.trained(outcomes.into_iter().map(|(_, outcome)| outcome)))
    }

    fn trained(&self, outcomes: impl Iterator<Item = train::Outcome>) -> TrainedHeads {
        let mut trained = TrainedHeads {
            head: self.clone(),
            heads: Vec::new(),
            diverged: Vec::new(),
        };
        for outcome in outcomes {
            match outcome {
                Ok(head) => trained.heads.push(head),
                Err(diverged) => trained.diverged.push(diverged),
            }
        }
        trained
    }
}
