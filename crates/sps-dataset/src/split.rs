use serde::{Deserialize, Deserializer, Serialize};

use crate::Surface;
use crate::units::{Unit, Units};

/// Which surfaces a model is fitted on and which it is judged by, as indices in ascending order.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Split {
    /// For fitting.
    pub train: Vec<usize>,
    /// Kept aside.
    pub validation: Vec<usize>,
}

/// How surfaces are split, as a config says it. Each way takes what it keeps together, `by`:
/// without it, groups where any has more than one surface, else surfaces.
///
/// ```
/// use sps_dataset::{SplitPlan, Surface};
///
/// let surfaces: Vec<_> = (0..400)
///     .map(|i| Surface { id: i.to_string(), material: String::new(), group: i.to_string() })
///     .collect();
/// let splits = SplitPlan::default().splits(&surfaces, 1, 0)?; // seed 1, rerun 0
/// assert_eq!((splits[0].train.len(), splits[0].validation.len()), (360, 40));
/// # Ok::<(), sps_dataset::SplitError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SplitPlan {
    /// One split at random, another for each rerun; the paper's, with a tenth kept aside.
    Random(RandomSplit),
    /// Every surface kept aside once; other folds in each rerun.
    KFold(KFold),
    /// Every surface, group or material kept aside once, on its own: what a model knows of one that
    /// it has not seen. The same splits in every rerun.
    #[serde(deserialize_with = "leave_one_out")]
    LeaveOneOut {
        /// What is kept together.
        by: Option<Unit>,
    },
}

/// Names a key that is not known, which a TOML reader does not do for a variant with fields.
fn leave_one_out<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Unit>, D::Error> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Keys {
        by: Option<Unit>,
    }
    Keys::deserialize(deserializer).map(|keys| keys.by)
}

/// The settings of [`SplitPlan::Random`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RandomSplit {
    /// The share of surfaces, groups or materials that is kept aside, between 0 and 1. Default 0.1,
    /// as in the paper (section 5).
    pub validation: f64,
    /// What is kept together.
    pub by: Option<Unit>,
}

/// The settings of [`SplitPlan::KFold`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct KFold {
    /// How many parts the surfaces are dealt into. Default 10.
    pub folds: usize,
    /// What is kept together.
    pub by: Option<Unit>,
}

/// Surfaces that cannot be split as asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SplitError {
    /// Fewer units than parts.
    #[error("{found} {unit} cannot be split into {wanted} parts")]
    TooFew {
        /// What is kept together.
        unit: Unit,
        /// How many there are.
        found: usize,
        /// How many parts were asked for.
        wanted: usize,
    },
    /// A share that is not between 0 and 1.
    #[error("`validation` is {0}, expected a share between 0 and 1")]
    Share(f64),
    /// A number of folds below two.
    #[error("`folds` is {0}, expected at least 2")]
    Folds(usize),
}

impl Default for SplitPlan {
    fn default() -> Self {
        Self::Random(RandomSplit::default())
    }
}

impl Default for RandomSplit {
    fn default() -> Self {
        Self {
            validation: 0.1,
            by: None,
        }
    }
}

impl Default for KFold {
    fn default() -> Self {
        Self {
            folds: 10,
            by: None,
        }
    }
}

impl SplitPlan {
    /// What the plan keeps together of these surfaces. Whoever splits one of its parts again
    /// (calibration, folds, early stopping) or counts them does so by the same units.
    pub fn units(&self, surfaces: &[Surface]) -> Units {
        let (Self::Random(RandomSplit { by, .. })
        | Self::KFold(KFold { by, .. })
        | Self::LeaveOneOut { by }) = self;
        match by {
            Some(unit) => Units::by(surfaces, *unit),
            None => Units::of(surfaces),
        }
    }

    /// The splits of one rerun: one at random, one per fold, or one per unit. They depend on
    /// nothing but the plan, the number and units of the surfaces, the seed and the rerun.
    ///
    /// # Errors
    /// Where there are too few units, or the plan makes no sense.
    pub fn splits(
        &self,
        surfaces: &[Surface],
        seed: u64,
        rerun: u64,
    ) -> Result<Vec<Split>, SplitError> {
        let units = self.units(surfaces);
        let all: Vec<usize> = (0..surfaces.len()).collect();
        match *self {
            Self::Random(RandomSplit { validation, .. }) => {
                let split = units.keep_aside(&all, validation, seed, "random split", rerun)?;
                Ok(vec![split])
            }
            Self::KFold(KFold { folds, .. }) => units.folds(&all, folds, seed, "folds", rerun),
            Self::LeaveOneOut { .. } => units.each_aside(&all),
        }
    }
}
