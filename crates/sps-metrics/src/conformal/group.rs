use std::collections::BTreeMap;

use super::{ConformalError, PredictionInterval, needed, rank, residuals, sizes};
use crate::double::Double;
use crate::level::{Level, reaches, steps};
use crate::samples::Samples;

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
/// assert_eq!((half.radius(), half.groups()), (0.5, 3));
/// assert_eq!(half.interval(5.0).low, 4.5);
///
/// // Three groups reach 3/4 and no more.
/// let refused = GroupConformal::from_residuals(&residuals, &groups, Level::P90);
/// assert!(refused.unwrap_err().to_string().ends_with("needs at least 9"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct GroupConformal {
    radius: f64,
    groups: usize,
    calibration: usize,
    level: Level,
}

impl GroupConformal {
    /// Calibrates on samples of groups that the model was not fitted to. `groups` says which group
    /// each sample is of, by any numbers, `(samples)`.
    ///
    /// # Errors
    ///
    /// As [`from_residuals`](Self::from_residuals);
    /// [`Undefined::LengthMismatch`](crate::Undefined::LengthMismatch), and
    /// [`Undefined::OutOfRange`](crate::Undefined::OutOfRange) where a residual overflows.
    pub fn calibrate(
        samples: Samples<'_>,
        groups: &[usize],
        level: Level,
    ) -> Result<Self, ConformalError> {
        Self::from_residuals(&residuals(samples)?, groups, level)
    }

    /// Calibrates on residuals, signed or absolute, in the unit of the truth; `groups` as in
    /// [`calibrate`](Self::calibrate).
    ///
    /// # Errors
    ///
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
            calibration: residuals.len(),
            level,
        })
    }

    /// Half the width of every interval, in the unit of the truth.
    pub const fn radius(&self) -> f64 {
        self.radius
    }

    /// How many groups it was calibrated on, K.
    pub const fn groups(&self) -> usize {
        self.groups
    }

    /// How many samples it was calibrated on.
    pub const fn calibration_samples(&self) -> usize {
        self.calibration
    }

    /// The level asked for: the least coverage to expect.
    pub const fn level(&self) -> Level {
        self.level
    }

    /// The interval around an estimate.
    pub fn interval(&self, estimate: f64) -> PredictionInterval {
        PredictionInterval::around(estimate, self.radius)
    }
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
