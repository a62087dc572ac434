use std::collections::BTreeMap;

use super::{ConformalError, needed, rank, sizes};
use crate::double::Double;
use crate::level::{Level, reaches, steps};

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

/// The least size up to which the shares sum to `reach`; the largest where none does. There is at
/// least one.
///
/// Shares are fractions like 1/3, whose sums are whole where the fractions make a whole: summed to
/// 106 bits, they do not depend on the order of equal sizes.
fn quantile(sized: impl Iterator<Item = (f64, Double)>, reach: f64) -> f64 {
    let mut ascending: Vec<(f64, Double)> = sized.collect();
    ascending.sort_by(|(size, _), (other, _)| size.total_cmp(other));
    let mut sum = Double::default();
    let reached = ascending.iter().find(|(_, share)| {
        sum += *share;
        reaches(sum.value(), reach)
    });
    reached.or(ascending.last()).map_or(0.0, |(size, _)| *size)
}
