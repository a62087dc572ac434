//! Intervals that cover at a promised rate, and whether they did.

use std::collections::BTreeMap;

use thiserror::Error;

use crate::double::Double;
use crate::level::{Level, reaches, steps};
use crate::moments::Moments;
use crate::outcome::{Quantity, Undefined};
use crate::screen::Screen;

/// The range in which a truth is expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictionInterval {
    /// The lower end, which belongs to the interval.
    pub low: f64,
    /// The upper end, which belongs to the interval.
    pub high: f64,
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
    /// With so few groups only an infinite interval covers a new one at this level: K groups reach
    /// K / (K + 1), seven 7/8.
    #[error(
        "{found} calibration group(s) allow a level of {found}/{}, a level of {} needs at least {needed}",
        found + 1,
        level.get()
    )]
    TooFewGroups {
        /// How many there are, K.
        found: usize,
        /// How many the level needs: the least K with (K + 1) level <= K.
        needed: usize,
        /// The level asked for.
        level: Level,
    },
    /// Samples and group numbers do not pair up.
    #[error("{groups} group numbers for {samples} samples")]
    GroupMismatch {
        /// How many samples there are.
        samples: usize,
        /// How many group numbers there are.
        groups: usize,
    },
}

impl PredictionInterval {
    /// The interval that reaches `radius` to either side of an estimate.
    pub fn around(estimate: f64, radius: f64) -> Self {
        Self {
            low: estimate - radius,
            high: estimate + radius,
        }
    }
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

/// Intervals that cover a sample of a *new group* at a promised rate, where samples come in groups
/// (photographs of one material, surfaces of one sheet) whose members are alike: hierarchical
/// conformal prediction (HCP; Lee, Barber and Willett, "Distribution-free inference with
/// hierarchical data", 2023; the same promise by subsampling one sample a group: Dunn, Wasserman
/// and Ramdas, "Distribution-Free Prediction Sets for Two-Layer Hierarchical Models", JASA, 2022).
///
/// With K groups of N_1, ..., N_K samples and absolute residuals s_ki, the radius is the quantile
/// at the level of
///
/// ```text
/// sum_k sum_i 1 / ((K + 1) N_k) δ(s_ki)  +  1 / (K + 1) δ(∞):
/// ```
///
/// every group counts the same, whatever its size, and the new group may be anything. The promise
/// needs groups that the model was not fitted to, exchangeable with each other and with the new
/// one, and samples exchangeable within a group; group sizes may be random and may go with how
/// hard a group is. Coverage is then at least the level, and less than 2 / (K + 1) above it where
/// no two residuals are equal. It holds on average over groups: of one new material's photographs
/// all may be covered or none.
///
/// [`SplitConformal`](crate::SplitConformal) promises nothing there, since a new group's sample is
/// not exchangeable with samples that come in clusters. With one sample a group both are the same
/// to the bit.
///
/// ```
/// use sps_metrics::{GroupConformal, Level};
///
/// // Three photographs of a first material, one each of two more.
/// let residuals = [0.1, 0.2, -0.3, 0.5, -0.7];
/// let groups = [0, 0, 0, 1, 2];
/// // Mass up to 0.5 of the three groups and the new one: (3/3 + 1) / 4.
/// let half = GroupConformal::from_residuals(&residuals, &groups, Level::new(0.5)?)?;
/// assert_eq!((half.radius, half.groups), (0.5, 3));
///
/// // Three groups reach 3/4 and no more.
/// let refused = GroupConformal::from_residuals(&residuals, &groups, Level::P90);
/// assert!(refused.unwrap_err().to_string().ends_with("needs at least 9"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroupConformal {
    /// Half the width of every interval, in the unit of the truth.
    pub radius: f64,
    /// How many groups it was calibrated on, K.
    pub groups: usize,
    /// The level asked for: the least coverage to expect.
    pub level: Level,
}

impl GroupConformal {
    /// Calibrates on residuals, signed or absolute, in the unit of the truth, of groups that the model
    /// was not fitted to. `groups` says which group each is of, by any numbers.
    ///
    /// # Errors
    /// [`ConformalError::TooFewGroups`] where the level needs more,
    /// [`ConformalError::GroupMismatch`]; [`Undefined::Empty`](crate::Undefined::Empty),
    /// [`Undefined::NonFinite`](crate::Undefined::NonFinite).
    pub fn from_residuals(
        residuals: &[f64],
        groups: &[usize],
        level: Level,
    ) -> Result<Self, ConformalError> {
        if residuals.len() != groups.len() {
            return Err(ConformalError::GroupMismatch {
                samples: residuals.len(),
                groups: groups.len(),
            });
        }
        let sizes = sizes(residuals)?;
        let mut members = BTreeMap::new();
        for group in groups {
            *members.entry(group).or_insert(0_usize) += 1;
        }
        let found = members.len();
        if rank(found, level) > found {
            return Err(ConformalError::TooFewGroups {
                found,
                needed: needed(level),
                level,
            });
        }
        let share = |group| Double::from(1.0) / Double::from(members[group] as f64);
        let shares = groups.iter().map(share);
        Ok(Self {
            radius: quantile(sizes.into_iter().zip(shares), steps(found + 1, level.get())),
            groups: found,
            level,
        })
    }
}

/// How intervals fared on truths.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    let is_inverted = |interval: &PredictionInterval| interval.low > interval.high;
    if let Some(index) = intervals.iter().position(is_inverted) {
        return Err(Undefined::InvertedInterval { index });
    }
    Ok(Coverage {
        covered,
        samples,
        // Finite ends whose distance is not: the width overflowed.
        mean_width: widths.mean().map_err(|_| Undefined::OutOfRange)?,
    })
}

/// The absolute residuals, at least one and all finite.
fn sizes(residuals: &[f64]) -> Result<Vec<f64>, Undefined> {
    let mut screen = Screen::default();
    for &residual in residuals {
        screen.admit([(Quantity::Residual, residual)]);
    }
    screen.samples()?;
    Ok(residuals.iter().map(|residual| residual.abs()).collect())
}

/// Which of n + 1 exchangeable ones in order, the new one among them, the level reaches.
fn rank(calibration: usize, level: Level) -> usize {
    (steps(calibration + 1, level.get()).ceil() as usize).max(1)
}

/// The least n with ceil((n + 1) level) <= n.
fn needed(level: Level) -> usize {
    // (n + 1) level <= n, solved for n; the neighbours absorb the rounding.
    let estimate = (level.get() / (1.0 - level.get())).ceil() as usize;
    let near = estimate.saturating_sub(1).max(1)..=estimate;
    near.into_iter()
        .find(|&n| rank(n, level) <= n)
        .unwrap_or(estimate.saturating_add(1))
}

/// The least size up to which the shares sum to `reach`; the largest where none does. There is at
/// least one.
///
/// Shares are fractions like 1/3, whose sums are whole where the fractions make a whole: summed to
/// 106 bits, they do not depend on the order of equal sizes.
fn quantile(sized: impl Iterator<Item = (f64, Double)>, reach: f64) -> f64 {
    let mut ascending: Vec<(f64, Double)> = sized.collect();
    ascending.sort_by(|(size, _), (other, _)| size.total_cmp(other));
    let mut sum = Double::default();
    let mut radius = 0.0;
    for (size, share) in ascending {
        sum += share;
        radius = size;
        if reaches(sum.value(), reach) {
            break;
        }
    }
    radius
}
