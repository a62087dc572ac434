use thiserror::Error;

use crate::level::{Level, steps};
use crate::moments::Moments;
use crate::outcome::{Quantity, Undefined};
use crate::samples::Samples;
use crate::screen::Screen;

/// The range in which a truth is expected.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PredictionInterval {
    /// The lower end, which belongs to the interval.
    pub low: f64,
    /// The upper end, which belongs to the interval.
    pub high: f64,
}

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

/// Why there is no interval that keeps its promise.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ConformalError {
    /// With so few samples only an infinite interval covers at this level.
    #[error("{found} calibration sample(s), a level of {} needs at least {needed}", level.get())]
    TooFewSamples {
        /// How many there are.
        found: usize,
        /// How many the level needs: the least n with ceil((n + 1) level) <= n.
        needed: usize,
        /// The level asked for.
        level: Level,
    },
    /// The residuals are undefined.
    #[error("the residuals are undefined: {0}")]
    Undefined(#[from] Undefined),
}

impl SplitConformal {
    /// Calibrates on samples that the model was not fitted to.
    ///
    /// # Errors
    ///
    /// As [`from_residuals`](Self::from_residuals); [`Undefined::LengthMismatch`], and
    /// [`Undefined::OutOfRange`] where a residual overflows.
    pub fn calibrate(samples: Samples<'_>, level: Level) -> Result<Self, ConformalError> {
        samples.accumulate()?.samples()?;
        let residuals = samples.pairs()?.map(|pair| pair.truth - pair.estimate);
        let residuals: Vec<f64> = residuals.collect();
        if residuals.iter().any(|residual| residual.is_infinite()) {
            return Err(Undefined::OutOfRange.into());
        }
        Self::from_residuals(&residuals, level)
    }

    /// Calibrates on residuals, signed or absolute, in the unit of the truth. The radius is the
    /// ceil((n + 1) level)-th smallest absolute residual.
    ///
    /// # Errors
    ///
    /// [`ConformalError::TooFewSamples`] where the level needs more; [`Undefined::Empty`],
    /// [`Undefined::NonFinite`].
    pub fn from_residuals(residuals: &[f64], level: Level) -> Result<Self, ConformalError> {
        let mut screen = Screen::default();
        for &residual in residuals {
            screen.admit([(Quantity::Residual, residual)]);
        }
        let calibration = screen.samples()?;
        let rank = rank(calibration, level);
        if rank > calibration {
            return Err(ConformalError::TooFewSamples {
                found: calibration,
                needed: needed(level),
                level,
            });
        }
        let mut sizes: Vec<f64> = residuals.iter().map(|residual| residual.abs()).collect();
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
        PredictionInterval {
            low: estimate - self.radius,
            high: estimate + self.radius,
        }
    }
}

/// Which of the n + 1 ordered residuals, the new one among them, the level reaches.
fn rank(calibration: usize, level: Level) -> usize {
    (steps(calibration + 1, level.get()).ceil() as usize).max(1)
}

fn needed(level: Level) -> usize {
    // (n + 1) level <= n, solved for n; the neighbours absorb the rounding.
    let estimate = (level.get() / (1.0 - level.get())).ceil() as usize;
    let near = estimate.saturating_sub(1).max(1)..=estimate;
    near.into_iter()
        .find(|&n| rank(n, level) <= n)
        .unwrap_or(estimate.saturating_add(1))
}

/// How intervals fared on truths.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Coverage {
    /// How many truths lie in their interval, its ends included.
    pub covered: usize,
    /// How many there are.
    pub samples: usize,
    /// Mean width of the intervals, in the unit of the truth.
    pub mean_width: f64,
}

impl Coverage {
    /// The share of truths that lie in their interval.
    pub fn fraction(&self) -> f64 {
        self.covered as f64 / self.samples as f64
    }
}

/// Empirical coverage and mean width of intervals, one per truth.
///
/// # Errors
///
/// [`Undefined::Empty`], [`Undefined::LengthMismatch`], [`Undefined::NonFinite`],
/// [`Undefined::InvertedInterval`], [`Undefined::OutOfRange`].
pub fn coverage(intervals: &[PredictionInterval], truth: &[f64]) -> Result<Coverage, Undefined> {
    if intervals.len() != truth.len() {
        return Err(Undefined::LengthMismatch {
            truths: truth.len(),
            estimates: intervals.len(),
        });
    }
    let mut screen = Screen::default();
    let mut widths = Moments::new();
    let mut covered = 0;
    for (interval, &truth) in intervals.iter().zip(truth) {
        let PredictionInterval { low, high } = *interval;
        screen.admit([
            (Quantity::Truth, truth),
            (Quantity::IntervalEnd, low),
            (Quantity::IntervalEnd, high),
        ]);
        covered += usize::from((low..=high).contains(&truth));
        widths.push(high - low);
    }
    let samples = screen.samples()?;
    if let Some(index) = intervals
        .iter()
        .position(|interval| interval.low > interval.high)
    {
        return Err(Undefined::InvertedInterval { index });
    }
    Ok(Coverage {
        covered,
        samples,
        // Finite ends whose distance is not: the width overflowed.
        mean_width: widths.mean().map_err(|_| Undefined::OutOfRange)?,
    })
}
