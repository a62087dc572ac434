//! What all estimators of tactile values have in common, for code that takes any of them.

use crate::data::Embeddings;
use crate::error::{Error, Result};
use crate::heads::{
    DivergedTrial, Estimates, Head, Plan, TrainedHead, TrainedHeads, TrainingData, Trial,
};
use crate::kernel_ridge::{KernelRidge, TrainedKernelRidge, TrainedKernelRidges};
use crate::nearest::{Nearest, TrainedNearest, TrainedNearests};
use crate::ridge::{Ridge, TrainedRidge, TrainedRidges};

/// An estimator that can be fitted to the trials of a plan.
pub trait Regressor: Sync {
    /// Fits every trial of the plan, on the threads of the current rayon pool. A trial's fit has
    /// the bits that it would have alone.
    ///
    /// # Errors
    ///
    /// A plan that does not fit the data or the estimator, what the estimator says, and a trial that
    /// comes to nothing: there is a model for every trial.
    fn fit(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<Box<dyn FittedRegressor>>;

    /// Whether the plans that it is fitted to must name a validation part
    /// ([`Rerun::validation`](crate::heads::Rerun::validation)).
    fn needs_validation(&self) -> bool {
        false
    }
}

/// Fitted models, one for each trial of a plan.
pub trait FittedRegressor: Send + Sync {
    /// What the models were fitted for, in the order of the plan.
    fn trials(&self) -> Vec<&Trial>;

    /// The estimates of every model for every surface, in measured units and in the order of the
    /// trials. The views of `embeddings` are the ones to use, in the order of the trials' views.
    ///
    /// # Errors
    ///
    /// Embeddings of another width or number of views than were fitted.
    fn predict(&self, embeddings: &Embeddings) -> Result<Vec<Estimates>>;

    /// The models for which `keep` says so.
    fn filtered(&self, keep: &dyn Fn(&Trial) -> bool) -> Box<dyn FittedRegressor>;

    /// Multiply-adds to estimate one surface from its embeddings, all models together.
    fn multiply_adds(&self) -> u64;
}

impl Regressor for Head {
    fn fit(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<Box<dyn FittedRegressor>> {
        let heads = self.train(data, plan, &())?;
        if let Some(DivergedTrial { trial, reason }) = heads.diverged().first() {
            let found = format!("{}, rerun {}: {reason}", trial.property, trial.rerun);
            return Err(Error::input("training", found, "losses that stay finite"));
        }
        Ok(Box::new(heads))
    }

    fn needs_validation(&self) -> bool {
        self.config().early_stopping.is_some()
    }
}

macro_rules! regressors {
    ($($regressor:ty),*) => {$(
        impl Regressor for $regressor {
            fn fit(
                &self,
                data: &TrainingData<'_>,
                plan: &Plan,
            ) -> Result<Box<dyn FittedRegressor>> {
                Ok(Box::new(self.train(data, plan)?))
            }
        }
    )*};
}

macro_rules! fitted {
    ($($fitted:ty, $models:ident, $model:ty;)*) => {$(
        impl FittedRegressor for $fitted {
            fn trials(&self) -> Vec<&Trial> {
                self.$models().iter().map(<$model>::trial).collect()
            }

            fn predict(&self, embeddings: &Embeddings) -> Result<Vec<Estimates>> {
                self.predict(embeddings)
            }

            fn filtered(&self, keep: &dyn Fn(&Trial) -> bool) -> Box<dyn FittedRegressor> {
                Box::new(self.filter(keep))
            }

            fn multiply_adds(&self) -> u64 {
                self.multiply_adds()
            }
        }
    )*};
}

regressors!(Ridge, KernelRidge, Nearest);

fitted! {
    TrainedHeads, heads, TrainedHead;
    TrainedRidges, ridges, TrainedRidge;
    TrainedKernelRidges, ridges, TrainedKernelRidge;
    TrainedNearests, nearests, TrainedNearest;
}

/// Refuses embeddings of another number of views or width than those of the training surfaces.
pub(crate) fn check_fits(
    what: &'static str,
    found: &Embeddings,
    training: &Embeddings,
) -> Result<()> {
    let told = |of: &Embeddings| format!("{} views of width {}", of.views(), of.width());
    if (found.views(), found.width()) == (training.views(), training.width()) {
        return Ok(());
    }
    Err(Error::input(what, told(found), told(training)))
}

/// Refuses the first number that is not finite.
pub(crate) fn check_finite(
    what: &'static str,
    numbers: impl IntoIterator<Item = f64>,
) -> Result<()> {
    match numbers.into_iter().find(|number| !number.is_finite()) {
        None => Ok(()),
        Some(number) => Err(Error::input(what, number, "finite numbers")),
    }
}
