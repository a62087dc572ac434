use super::{ConformalError, needed, rank, sizes};
use crate::level::Level;

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
/// use sps_metrics::{Level, PredictionInterval, SplitConformal};
///
/// let residuals = [0.3, -0.1, 0.2, -0.7, 0.5, 0.4, -0.6, 0.9, -0.8];
/// let conformal = SplitConformal::from_residuals(&residuals, Level::P90)?;
/// assert_eq!(conformal.radius, 0.9); // the 9th smallest: ceil(10 * 0.9)
/// assert_eq!(PredictionInterval::around(5.0, conformal.radius).low, 4.1);
/// assert!(SplitConformal::from_residuals(&residuals[1..], Level::P90).is_err());
/// # Ok::<(), sps_metrics::ConformalError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitConformal {
    /// Half the width of every interval, in the unit of the truth.
    pub radius: f64,
    /// How many samples it was calibrated on.
    pub samples: usize,
    /// The level asked for.
    pub level: Level,
}

impl SplitConformal {
    /// Calibrates on residuals, signed or absolute, in the unit of the truth, of samples that the model
    /// was not fitted to. The radius is the ceil((n + 1) level)-th smallest absolute residual.
    ///
    /// # Errors
    /// [`ConformalError::TooFewSamples`] where the level needs more;
    /// [`Undefined::Empty`](crate::Undefined::Empty),
    /// [`Undefined::NonFinite`](crate::Undefined::NonFinite).
    pub fn from_residuals(residuals: &[f64], level: Level) -> Result<Self, ConformalError> {
        let mut sizes = sizes(residuals)?;
        let samples = sizes.len();
        let rank = rank(samples, level);
        if rank > samples {
            return Err(ConformalError::TooFewSamples {
                found: samples,
                needed: needed(level),
                level,
            });
        }
        let (_, &mut radius, _) = sizes.select_nth_unstable_by(rank - 1, f64::total_cmp);
        Ok(Self {
            radius,
            samples,
            level,
        })
    }

    /// The coverage to expect, ceil((n + 1) level) / (n + 1): at least the level, and above it by less
    /// than 1 / (n + 1). Exact where no two residuals are equal.
    pub fn expected_coverage(&self) -> f64 {
        rank(self.samples, self.level) as f64 / (self.samples + 1) as f64
    }
}
