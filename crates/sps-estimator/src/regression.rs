//! What turns embeddings into estimates, before it is fitted.

use serde_json::{Value, json};
use sps_dataset::Units;
use sps_models::heads::{Head, HeadConfig, Input, Observer};
use sps_regress::stacking::Stacking;
use sps_regress::{AnyRegressor, DivergedTrial, FittedRegressor, Plan, Regressor, TrainingData};

use crate::error::{Error, Result, refuse};

/// One of the regressions that there are, with its settings.
///
/// ```
/// use sps_estimator::Regression;
/// use sps_regress::{AnyRegressor, RegressorKind, RegressorSettings};
///
/// let kernel = AnyRegressor::new(RegressorKind::KernelRidge, &RegressorSettings::default())?;
/// assert_eq!(Regression::Rows(kernel).kind(), "kernel-ridge");
/// # Ok::<(), sps_regress::Error>(())
/// ```
#[derive(Clone, Debug)]
pub enum Regression {
    /// A network: the paper's cross-modal one, or a part of it.
    Head(Head),
    /// One that takes embeddings as rows of numbers.
    Rows(AnyRegressor),
    /// Several, weighed by how well each does out of fold.
    Stacked(Stacked),
}

/// Several regressions as one ([`Stacking`]).
#[derive(Clone, Debug)]
pub struct Stacked {
    /// What is stacked; none of them a stack.
    pub members: Vec<Regression>,
    /// Parts of the training surfaces, of which each is estimated by members that were trained on the
    /// others to weigh them.
    pub folds: usize,
}

impl Regression {
    /// As configs and artefacts call it.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Head(_) => "head",
            Self::Rows(regressor) => regressor.kind().name(),
            Self::Stacked(_) => "stacked",
        }
    }

    /// All that an estimate depends on beside the data, as JSON.
    ///
    /// # Errors
    /// Settings that JSON cannot hold.
    pub fn settings(&self) -> serde_json::Result<Value> {
        Ok(match self {
            Self::Head(head) => serde_json::to_value(head.config())?,
            Self::Rows(regressor) => regressor.settings()?,
            Self::Stacked(stacked) => {
                let members = stacked.members.iter().map(Self::settings);
                let members = members.collect::<serde_json::Result<Vec<Value>>>()?;
                json!({ "folds": stacked.folds, "members": members })
            }
        })
    }

    /// The network, where there is one.
    pub fn head(&self) -> Option<&Head> {
        match self {
            Self::Head(head) => Some(head),
            Self::Stacked(stacked) => stacked.members.iter().find_map(Self::head),
            Self::Rows(_) => None,
        }
    }

    /// Training surfaces that a fit stands on at most, where there is a bound.
    pub fn at_most(&self) -> Option<usize> {
        match self {
            Self::Rows(regressor) => regressor.at_most(),
            Self::Stacked(stacked) => stacked.members.iter().filter_map(Self::at_most).min(),
            Self::Head(_) => None,
        }
    }

    /// With every network changed.
    ///
    /// # Errors
    /// A network that cannot be as `change` says.
    pub fn with_heads(&self, change: &impl Fn(&HeadConfig) -> HeadConfig) -> Result<Self> {
        Ok(match self {
            Self::Head(head) => Self::Head(Head::new(change(head.config()))?),
            Self::Stacked(stacked) => {
                let members = stacked.members.iter();
                let members = members.map(|member| member.with_heads(change));
                Self::Stacked(Stacked {
                    members: members.collect::<Result<_>>()?,
                    folds: stacked.folds,
                })
            }
            Self::Rows(regressor) => Self::Rows(regressor.clone()),
        })
    }

    /// With networks that take this input.
    ///
    /// # Errors
    /// As [`Regression::with_heads`].
    pub fn with_input(&self, input: &Input) -> Result<Self> {
        self.with_heads(&|config| HeadConfig {
            input: input.clone(),
            ..config.clone()
        })
    }

    /// With networks that take so many views: those that pool views take any number.
    ///
    /// # Errors
    /// As [`Regression::with_heads`].
    pub fn with_views(&self, views: usize) -> Result<Self> {
        let pools = |head: &Head| head.config().input == (Input::ViewPooling {});
        if self.head().is_some_and(pools) {
            return Ok(self.clone());
        }
        self.with_input(&Input::LateFusion { views })
    }

    /// Fits the trials of a plan; those that come to nothing have no model and are among
    /// [`FittedRegressor::diverged`]. `units` stay whole where a network keeps surfaces aside to know
    /// when to stop.
    ///
    /// # Errors
    /// What the regression says of the data and the plan, and too few units to keep any aside.
    pub fn fit_some(
        &self,
        data: &TrainingData<'_>,
        units: &Units,
        plan: &Plan,
        observer: &dyn Observer,
    ) -> Result<Box<dyn FittedRegressor>> {
        Ok(match self {
            Self::Head(head) => {
                let plan = early_stopped(head, units, plan.clone())?;
                Box::new(head.train(data, &plan, observer)?)
            }
            Self::Rows(regressor) => regressor.fit(data, plan)?,
            Self::Stacked(stacked) => {
                let members = stacked.members.iter().map(Self::member);
                let stacking = Stacking::new(members.collect::<Result<_>>()?, stacked.folds)?;
                stacking.fit(data, plan)?
            }
        })
    }

    /// Fits the trials of a plan, all of them.
    ///
    /// # Errors
    /// As [`Regression::fit_some`], and a trial that comes to nothing.
    pub fn fit(
        &self,
        data: &TrainingData<'_>,
        units: &Units,
        plan: &Plan,
    ) -> Result<Box<dyn FittedRegressor>> {
        let fitted = self.fit_some(data, units, plan, &())?;
        match fitted.diverged().first() {
            None => Ok(fitted),
            Some(DivergedTrial { trial, reason }) => Err(Error::Diverged {
                property: trial.property.clone(),
                rerun: trial.rerun,
                reason: reason.clone(),
            }),
        }
    }

    fn member(&self) -> Result<Box<dyn Regressor>> {
        Ok(match self {
            Self::Head(head) => Box::new(head.clone()),
            Self::Rows(regressor) => Box::new(regressor.clone()),
            Self::Stacked(_) => {
                return refuse("members of a stack", "a stack", "others");
            }
        })
    }
}

/// The plan with a validation part of each rerun where the head stops early; units stay whole.
///
/// # Errors
/// Too few units to keep any aside.
pub fn early_stopped(head: &Head, units: &Units, mut plan: Plan) -> Result<Plan> {
    let Some(stopping) = head.config().early_stopping else {
        return Ok(plan);
    };
    for rerun in &mut plan.reruns {
        let (share, number) = (stopping.validation, rerun.number);
        let split =
            units.keep_aside(&rerun.training, share, plan.seed, "early stopping", number)?;
        rerun.training = split.train;
        rerun.validation = split.validation;
    }
    Ok(plan)
}
