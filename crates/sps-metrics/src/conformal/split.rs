use super::{ConformalError, PredictionInterval, needed, rank, residuals, sizes};
use crate::level::Level;
use crate::samples::Samples;

/// Intervals around estimates that cover the truth at a promised rate, whatever the model and
/// whatever the distribution: split conformal prediction (Vovk, Gammerman and Shafer, "Algorithmic
/// Learning in a Random World", 2005; Lei, G'Sell, Rinaldo, Tibshirani and Wasserman,
/// "Distribution-Free Predictive Inference for Regression", JASA 113, 2018, section 2.2).
///
/// The promise needs calibration samples that the model was not fitted to and that are
/// exchangeable with those to come. Photographs of the surfaces the model was fitted to are not
/// exchangeable with photographs of new surfaces: calibrate on surfaces kept apart. It holds on
/// average over calibration sets and over samples, not for each property value or material.
///
/// ```
/// use sps_metrics::{Level, SplitConformal};
///
/// let residuals = [0.3, -0.1, 0.2, -0.7, 0.5, 0.4, -0.6, 0.9, -0.8];
/// let conformal = SplitConformal::from_residuals(&residuals, Level::P90)?;
/// assert_eq!(conformal.radius(), 0.9); // the 9th smallest: ceil(10 * 0.9)
/// assert_eq!(conformal.interval(5.0).low, 4.1);
/// assert!(SplitConformal::from_residuals(&residuals[1..], Level::P90).is_err());
/// # Ok::<(), sps_metrics::ConformalError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SplitConformal {
    radius: f64,
    rank: usize,
    calibration: usize,
    level: Level,
}

impl SplitConformal {
    /// Calibrates on samples that the model was not fitted to.
    ///
    /// # Errors
    ///
    /// As [`from_residuals`](Self::from_residuals);
    /// [`Undefined::LengthMismatch`](crate::Undefined::LengthMismatch), and
    /// [`Undefined::OutOfRange`](crate::Undefined::OutOfRange) where a residual overflows.
    pub fn calibrate(samples: Samples<'_>, level: Level) -> Result<Self, ConformalError> {
        Self::from_residuals(&residuals(samples)?, level)
    }

    /// Calibrates on residuals, signed or absolute, in the unit of the truth. The radius is the
    /// ceil((n + 1) level)-th smallest absolute residual.
    ///
    /// # Errors
    ///
    /// [`ConformalError::TooFewSamples`] where the level needs more;
    /// [`Undefined::Empty`](crate::Undefined::Empty),
    /// [`Undefined::NonFinite`](crate::Undefined::NonFinite).
    pub fn from_residuals(residuals: &[f64], level: Level) -> Result<Self, ConformalError> {
        let mut sizes = sizes(residuals)?;
        let calibration = sizes.len();
        let rank = rank(calibration, level);
        if rank > calibration {
            return Err(ConformalError::TooFewSamples {
                found: calibration,
                needed: needed(level),
                level,
            });
        }
        let (_, &mut radius, _) = sizes.select_nth_unstable_by(rank - 1, f64::total_cmp);
        Ok(Self {
            radius,
            rank,
            calibration,
            level,
        })
    }

    /// Half the width of every interval, in the unit of the truth.
    pub const fn radius(&self) -> f64 {
        self.radius
    }

    /// How many samples it was calibrated on.
    pub const fn calibration_samples(&self) -> usize {
        self.calibration
    }

    /// The level asked for.
    pub const fn level(&self) -> Level {
        self.level
    }

    /// The coverage to expect, rank / (n + 1): at least the level, and above it by less than
    /// 1 / (n + 1). Exact where no two residuals are equal.
    pub fn expected_coverage(&self) -> f64 {
        self.rank as f64 / (self.calibration + 1) as f64
    }

    /// The interval around an estimate.
    pub fn interval(&self, estimate: f64) -> PredictionInterval {
        PredictionInterval::around(estimate, self.radius)
    }
}
