//! What all estimators of tactile values have in common, for code that takes any of them.

use crate::data::Embeddings;
use crate::error::{Error, Result};
use crate::heads::{
    DivergedTrial, Estimates, Head, Plan, TrainedHead, TrainedHeads, TrainingData, Trial,
};
use crate::kernel_ridge::{KernelRidge, TrainedKernelRidge, TrainedKernelRidges};
use crate::nearest::{Nearest, TrainedNearest, TrainedNearests};
use crate::ridge::{Ridge, TrainedRidge, TrainedRidges};
use crate::stacking::{self, TrainedStacks};

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

    /// What [`fitted_from_bytes`] reads the models by: `heads`, `ridges`, `kernel-ridges`, `nearest`,
    /// `stacks`, or a name that it does not know.
    fn kind(&self) -> &'static str;

    /// The models as the content of a file; the same models give the same bytes.
    ///
    /// # Errors
    ///
    /// A number that is not finite, and models of a kind that is not kept.
    fn to_bytes(&self) -> Result<Vec<u8>>;

    /// The trials without a model, in the order of the plan: training came to nothing.
    fn diverged(&self) -> &[DivergedTrial] {
        &[]
    }
}

pub(crate) const HEADS: &str = "heads";
pub(crate) const RIDGES: &str = "ridges";
pub(crate) const KERNEL_RIDGES: &str = "kernel-ridges";
pub(crate) const NEAREST: &str = "nearest";
pub(crate) const STACKS: &str = "stacks";

/// The kinds that can be read.
const KINDS: [&str; 5] = [HEADS, RIDGES, KERNEL_RIDGES, NEAREST, STACKS];

/// Reads what [`FittedRegressor::to_bytes`] gave of models of this [kind](FittedRegressor::kind);
/// `name` stands for the bytes in error messages.
///
/// ```
/// # use candle_core::{Device, Tensor};
/// # use sps_models::heads::{Plan, Rerun, TrainingData};
/// # use sps_models::{Embeddings, Readings};
/// use sps_models::nearest::Nearest;
/// use sps_models::{Regressor, fitted_from_bytes};
///
/// # let embeddings = Embeddings::new(&Tensor::new(&[[1.0_f32], [2.0]], &Device::Cpu)?)?;
/// # let readings = Readings::new(vec!["friction".into()], &[vec![Some(3.0)], vec![Some(4.0)]])?;
/// # let data = TrainingData::new(&embeddings, &readings);
/// # let rerun = Rerun { number: 0, training: vec![0, 1], validation: vec![] };
/// # let plan = Plan::each(7, readings.properties(), vec![rerun]);
/// let fitted = Nearest.fit(&data, &plan)?;
/// let bytes = fitted.to_bytes()?;
/// let read = fitted_from_bytes(fitted.kind(), "model.bin", &bytes)?;
/// assert_eq!(read.predict(&embeddings)?, fitted.predict(&embeddings)?);
/// # Ok::<(), sps_models::Error>(())
/// ```
///
/// # Errors
///
/// A kind that there is not, and bytes that are not models of it.
pub fn fitted_from_bytes(kind: &str, name: &str, bytes: &[u8]) -> Result<Box<dyn FittedRegressor>> {
    fitted_within(stacking::MOST_DEPTH, kind, name, bytes)
}

/// The same, of stacks that hold others at most so deep, themselves included.
pub(crate) fn fitted_within(
    depth: usize,
    kind: &str,
    name: &str,
    bytes: &[u8],
) -> Result<Box<dyn FittedRegressor>> {
    fn boxed<F: FittedRegressor + 'static>(fitted: F) -> Box<dyn FittedRegressor> {
        Box::new(fitted)
    }
    let read = match kind {
        // What is said of them names the file already.
        HEADS => return TrainedHeads::from_bytes(name, bytes).map(boxed),
        RIDGES => TrainedRidges::from_bytes(bytes).map(boxed),
        KERNEL_RIDGES => TrainedKernelRidges::from_bytes(bytes).map(boxed),
        NEAREST => TrainedNearests::from_bytes(bytes).map(boxed),
        STACKS => TrainedStacks::from_bytes_within(depth, bytes).map(boxed),
        _ => Err(unknown(kind)),
    };
    read.map_err(|error| Error::Kept {
        name: name.to_owned(),
        source: Box::new(error),
    })
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
    ($($fitted:ty, $kind:ident, $models:ident, $model:ty $(, $diverged:ident)?;)*) => {$(
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

            fn kind(&self) -> &'static str {
                $kind
            }

            fn to_bytes(&self) -> Result<Vec<u8>> {
                self.to_bytes()
            }

            $(fn diverged(&self) -> &[DivergedTrial] {
                self.$diverged()
            })?
        }
    )*};
}

regressors!(Ridge, KernelRidge, Nearest);

fitted! {
    TrainedHeads, HEADS, heads, TrainedHead, diverged;
    TrainedRidges, RIDGES, ridges, TrainedRidge;
    TrainedKernelRidges, KERNEL_RIDGES, ridges, TrainedKernelRidge;
    TrainedNearests, NEAREST, nearests, TrainedNearest;
}

/// Refuses models that could not be read again.
pub(crate) fn check_kept(models: &dyn FittedRegressor) -> Result<()> {
    if KINDS.contains(&models.kind()) {
        return Ok(());
    }
    Err(unknown(models.kind()))
}

fn unknown(kind: &str) -> Error {
    let expected = format_args!("one of {}", KINDS.join(", "));
    Error::input("kind of fitted models", format_args!("{kind:?}"), expected)
}

/// Refuses embeddings of another number of views or width than those of the training surfaces.
pub(crate) fn check_fits(
    what: &'static str,
    found: &Embeddings,
    training: &Embeddings,
) -> Result<()> {
    let told = |of: &Embeddings| match of.blocks() {
        [_] => format!("{} views of width {}", of.views(), of.width()),
        blocks => format!("{} views of blocks {blocks:?}", of.views()),
    };
    if (found.views(), found.blocks()) == (training.views(), training.blocks()) {
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
