//! What all estimators of tactile values have in common, for code that takes any of them.

use serde::{Deserialize, Serialize};

use crate::data::Embeddings;
use crate::error::{Error, Result};
use crate::fitted::FittedModel as _;
use crate::kernel_ridge::{
    KernelRidge, KernelRidgeConfig, TrainedKernelRidge, TrainedKernelRidges,
};
use crate::nearest::{Nearest, TrainedNearest, TrainedNearests};
use crate::plan::{Plan, TrainingData, Trial};
use crate::ridge::{Ridge, RidgeConfig, TrainedRidge, TrainedRidges};
use crate::stacking::{self, TrainedStacks};

/// The estimates of one model.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimates {
    /// The property.
    pub property: String,
    /// The rerun of the model.
    pub rerun: u64,
    /// One value per surface, in the property's measured units.
    pub values: Vec<f64>,
}

/// A trial whose training came to nothing, while the others of its plan went on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct DivergedTrial {
    /// Which.
    pub trial: Trial,
    /// What is no longer finite, and where; to be read.
    pub reason: String,
}

/// An estimator that can be fitted to the trials of a plan.
pub trait Regressor: Sync {
    /// Fits every trial of the plan, on the threads of the current rayon pool. A trial's fit has
    /// the bits that it would have alone.
    ///
    /// # Errors
    /// A plan that does not fit the data or the estimator, what the estimator says, and a trial that
    /// comes to nothing: there is a model for every trial.
    fn fit(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<Box<dyn FittedRegressor>>;

    /// Whether the plans that it is fitted to must name a validation part
    /// ([`Rerun::validation`](crate::Rerun::validation)).
    fn needs_validation(&self) -> bool {
        false
    }
}

/// The regressors of this crate that are no stack, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RegressorKind {
    /// Ridge regression.
    Ridge,
    /// Kernel ridge regression.
    KernelRidge,
    /// The reading of the nearest neighbour.
    Nearest,
}

impl RegressorKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Ridge, Self::KernelRidge, Self::Nearest];

    /// The name in configurations.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ridge => "ridge",
            Self::KernelRidge => "kernel-ridge",
            Self::Nearest => "nearest",
        }
    }

    /// The name in a report.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Ridge => "Ridge regression",
            Self::KernelRidge => "Kernel ridge regression",
            Self::Nearest => "Nearest neighbour",
        }
    }
}

/// The settings of each, as configurations have them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct RegressorSettings {
    /// Of ridge regression.
    pub ridge: RidgeConfig,
    /// Of kernel ridge regression.
    pub kernel_ridge: KernelRidgeConfig,
}

/// One of the regressors of this crate that are no stack, with its settings.
///
/// ```
/// use sps_regress::{AnyRegressor, RegressorKind, RegressorSettings};
///
/// let kernel = AnyRegressor::new(RegressorKind::KernelRidge, &RegressorSettings::default())?;
/// assert_eq!((kernel.kind().name(), kernel.at_most()), ("kernel-ridge", Some(4000)));
/// # Ok::<(), sps_regress::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum AnyRegressor {
    /// Ridge regression.
    Ridge(Ridge),
    /// Kernel ridge regression.
    KernelRidge(KernelRidge),
    /// The reading of the nearest neighbour.
    Nearest,
}

impl AnyRegressor {
    /// The one of this kind.
    ///
    /// # Errors
    /// Settings that it refuses.
    pub fn new(kind: RegressorKind, settings: &RegressorSettings) -> Result<Self> {
        Ok(match kind {
            RegressorKind::Ridge => Self::Ridge(Ridge::new(settings.ridge.clone())?),
            RegressorKind::KernelRidge => {
                Self::KernelRidge(KernelRidge::new(settings.kernel_ridge.clone())?)
            }
            RegressorKind::Nearest => Self::Nearest,
        })
    }

    /// Which one it is.
    pub const fn kind(&self) -> RegressorKind {
        match self {
            Self::Ridge(_) => RegressorKind::Ridge,
            Self::KernelRidge(_) => RegressorKind::KernelRidge,
            Self::Nearest => RegressorKind::Nearest,
        }
    }

    /// All that an estimate depends on beside the data, as JSON.
    ///
    /// # Errors
    /// Settings that JSON cannot hold.
    pub fn settings(&self) -> serde_json::Result<serde_json::Value> {
        match self {
            Self::Ridge(ridge) => serde_json::to_value(ridge.config()),
            Self::KernelRidge(ridge) => serde_json::to_value(ridge.config()),
            Self::Nearest => Ok(self.kind().name().into()),
        }
    }

    /// Training surfaces that a fit stands on at most, where there is a bound.
    pub fn at_most(&self) -> Option<usize> {
        match self {
            Self::KernelRidge(ridge) => Some(ridge.config().at_most),
            Self::Ridge(_) | Self::Nearest => None,
        }
    }
}

impl Regressor for AnyRegressor {
    fn fit(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<Box<dyn FittedRegressor>> {
        match self {
            Self::Ridge(ridge) => ridge.fit(data, plan),
            Self::KernelRidge(ridge) => ridge.fit(data, plan),
            Self::Nearest => Nearest.fit(data, plan),
        }
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
    /// Embeddings of another width or number of views than were fitted.
    fn predict(&self, embeddings: &Embeddings) -> Result<Vec<Estimates>>;

    /// The models for which `keep` says so.
    fn filtered(&self, keep: &dyn Fn(&Trial) -> bool) -> Box<dyn FittedRegressor>;

    /// Multiply-adds to estimate one surface from its embeddings, all models together.
    fn multiply_adds(&self) -> u64;

    /// What [`fitted_from_bytes`] reads the models by: `ridges`, `kernel-ridges`, `nearest`, `stacks`, or
    /// the name of [another kind](OtherKind).
    fn kind(&self) -> &'static str;

    /// The models as the content of a file; the same models give the same bytes.
    ///
    /// # Errors
    /// A number that is not finite, and models of a kind that is not kept.
    fn to_bytes(&self) -> Result<Vec<u8>>;

    /// The trials without a model, in the order of the plan: training came to nothing.
    fn diverged(&self) -> &[DivergedTrial] {
        &[]
    }
}

/// Reads fitted models from bytes, for which a name stands in error messages.
pub type Read = fn(&str, &[u8]) -> Result<Box<dyn FittedRegressor>>;

/// A kind of fitted models that another crate has.
#[derive(Clone, Copy, Debug)]
pub struct OtherKind {
    /// Its [name](FittedRegressor::kind).
    pub kind: &'static str,
    /// Reads what [`FittedRegressor::to_bytes`] gave.
    pub read: Read,
}

/// Reads what [`FittedRegressor::to_bytes`] gave of models of this [kind](FittedRegressor::kind), one of this
/// crate or of `others`; `name` stands for the bytes in error messages.
///
/// # Errors
/// A kind that there is not, and bytes that are not models of it.
pub fn fitted_from_bytes(
    kind: &str,
    name: &str,
    bytes: &[u8],
    others: &[OtherKind],
) -> Result<Box<dyn FittedRegressor>> {
    fitted_within(stacking::MOST_DEPTH, kind, name, bytes, others)
}

/// The same, of stacks that hold others at most so deep, themselves included.
pub(crate) fn fitted_within(
    depth: usize,
    kind: &str,
    name: &str,
    bytes: &[u8],
    others: &[OtherKind],
) -> Result<Box<dyn FittedRegressor>> {
    if let Some(other) = others.iter().find(|other| other.kind == kind) {
        return (other.read)(name, bytes);
    }
    let read = match kind {
        TrainedRidge::KIND => boxed(TrainedRidges::from_bytes(bytes)),
        TrainedKernelRidge::KIND => boxed(TrainedKernelRidges::from_bytes(bytes)),
        TrainedNearest::KIND => boxed(TrainedNearests::from_bytes(bytes)),
        stacking::KIND => boxed(TrainedStacks::from_bytes(depth, bytes, others)),
        _ => {
            let kinds = others.iter().map(|other| other.kind).chain(OWN_KINDS);
            let expected = format!("one of {}", kinds.collect::<Vec<_>>().join(", "));
            let found = format_args!("{kind:?}");
            Err(Error::input("kind of fitted models", found, expected))
        }
    };
    read.map_err(|error| Error::Kept {
        name: name.to_owned(),
        source: Box::new(error),
    })
}

const OWN_KINDS: [&str; 4] = [
    TrainedRidge::KIND,
    TrainedKernelRidge::KIND,
    TrainedNearest::KIND,
    stacking::KIND,
];

fn boxed(fitted: Result<impl FittedRegressor + 'static>) -> Result<Box<dyn FittedRegressor>> {
    Ok(Box::new(fitted?))
}

macro_rules! regressors {
    ($($regressor:ty),*) => {$(
        impl Regressor for $regressor {
            fn fit(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<Box<dyn FittedRegressor>> {
                boxed(self.train(data, plan))
            }
        }
    )*};
}

regressors!(Ridge, KernelRidge, Nearest);

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

/// Refuses settings to choose from that are none, or not above zero.
pub(crate) fn check_positive(what: &'static str, list: &[f64]) -> Result<()> {
    if list.is_empty() {
        return Err(Error::input(what, "none", "at least one"));
    }
    match list.iter().find(|&&v| !(v.is_finite() && v > 0.0)) {
        None => Ok(()),
        Some(value) => Err(Error::input(what, value, "numbers above 0")),
    }
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
