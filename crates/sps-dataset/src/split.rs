use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use crate::Surface;
use crate::stream::Stream;

/// Which surfaces a model is fitted on and which it is judged by, as indices in ascending order.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Split {
    /// For fitting.
    pub train: Vec<usize>,
    /// Kept aside.
    pub validation: Vec<usize>,
}

/// How surfaces are split, as a config says it.
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
    /// Every surface kept aside once.
    KFold(KFold),
}

/// The settings of [`SplitPlan::Random`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct RandomSplit {
    /// The share that is kept aside, between 0 and 1. Default 0.1, as in the paper (section 5).
    pub validation: f64,
    /// Whether surfaces of one group stay together. Default false, as in the paper.
    pub keep_groups: bool,
}

/// The settings of [`SplitPlan::KFold`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct KFold {
    /// How many parts the surfaces are dealt into. Default 10.
    pub folds: usize,
    /// Whether surfaces of one group stay together. Default false.
    pub keep_groups: bool,
}

/// Surfaces that cannot be split as asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SplitError {
    /// Fewer units than parts. A unit is a surface, or a group where groups are kept.
    #[error("{found} {unit} cannot be split into {wanted} parts")]
    TooFew {
        /// `surfaces` or `groups`.
        unit: &'static str,
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
            keep_groups: false,
        }
    }
}

impl Default for KFold {
    fn default() -> Self {
        Self {
            folds: 10,
            keep_groups: false,
        }
    }
}

impl SplitPlan {
    /// The splits of one rerun: one at random, or one per fold. They depend on nothing but the
    /// plan, the number and groups of the surfaces, the seed and the rerun.
    ///
    /// # Errors
    /// Where there are too few surfaces or groups, or the plan makes no sense.
    pub fn splits(
        &self,
        surfaces: &[Surface],
        seed: u64,
        rerun: u64,
    ) -> Result<Vec<Split>, SplitError> {
        let parts = match *self {
            Self::Random(RandomSplit {
                validation,
                keep_groups,
            }) => {
                if !(validation > 0.0 && validation < 1.0) {
                    return Err(SplitError::Share(validation));
                }
                let units = shuffled(surfaces, keep_groups, 2, seed, "random split", rerun)?;
                vec![kept_aside(&units, surfaces.len(), validation)]
            }
            Self::KFold(KFold { folds, keep_groups }) => {
                if folds < 2 {
                    return Err(SplitError::Folds(folds));
                }
                deal(
                    shuffled(surfaces, keep_groups, folds, seed, "folds", rerun)?,
                    folds,
                )
            }
        };
        Ok(parts
            .into_iter()
            .map(|part| Split::keeping_aside(part, surfaces.len()))
            .collect())
    }
}

impl Split {
    fn keeping_aside(mut validation: Vec<usize>, surfaces: usize) -> Self {
        validation.sort_unstable();
        let train = (0..surfaces)
            .filter(|i| validation.binary_search(i).is_err())
            .collect();
        Self { train, validation }
    }
}

/// The units that stay together, in random order; at least `parts` of them.
fn shuffled(
    surfaces: &[Surface],
    keep_groups: bool,
    parts: usize,
    seed: u64,
    purpose: &str,
    rerun: u64,
) -> Result<Vec<Vec<usize>>, SplitError> {
    let mut units: Vec<Vec<usize>> = Vec::new();
    let mut unit_of: HashMap<&str, usize> = HashMap::new();
    for (index, surface) in surfaces.iter().enumerate() {
        let own = units.len();
        let unit = if keep_groups {
            *unit_of.entry(&surface.group).or_insert(own)
        } else {
            own
        };
        if unit == own {
            units.push(Vec::new());
        }
        units[unit].push(index);
    }
    if units.len() < parts {
        let unit = if keep_groups { "groups" } else { "surfaces" };
        return Err(SplitError::TooFew {
            unit,
            found: units.len(),
            wanted: parts,
        });
    }
    Stream::new(seed, purpose, rerun).shuffle(&mut units);
    Ok(units)
}

/// Takes, in order, each unit that brings the part nearer to the share asked for; the smallest
/// where none does. At least one unit is left over.
fn kept_aside(units: &[Vec<usize>], surfaces: usize, share: f64) -> Vec<usize> {
    let wanted = ((surfaces as f64 * share).round() as usize).clamp(1, surfaces - 1);
    let mut part: Vec<usize> = Vec::new();
    for unit in units {
        let with_it = part.len() + unit.len();
        if with_it.abs_diff(wanted) < part.len().abs_diff(wanted) && with_it < surfaces {
            part.extend(unit);
        }
    }
    if part.is_empty() {
        part.extend(
            units
                .iter()
                .min_by_key(|unit| unit.len())
                .into_iter()
                .flatten(),
        );
    }
    part
}

/// Deals units out, large ones first, each to the part that is smallest so far.
fn deal(mut units: Vec<Vec<usize>>, parts: usize) -> Vec<Vec<usize>> {
    units.sort_by_key(|unit| std::cmp::Reverse(unit.len()));
    let mut dealt: Vec<Vec<usize>> = vec![Vec::new(); parts];
    for unit in units {
        if let Some(smallest) = dealt.iter_mut().min_by_key(|part| part.len()) {
            smallest.extend(unit);
        }
    }
    dealt
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn surfaces(groups: &[u8]) -> Vec<Surface> {
        let surface = |(i, group): (usize, &u8)| Surface {
            id: i.to_string(),
            material: String::new(),
            group: group.to_string(),
        };
        groups.iter().enumerate().map(surface).collect()
    }

    fn random(validation: f64, keep_groups: bool) -> SplitPlan {
        SplitPlan::Random(RandomSplit {
            validation,
            keep_groups,
        })
    }

    fn k_fold(folds: usize, keep_groups: bool) -> SplitPlan {
        SplitPlan::KFold(KFold { folds, keep_groups })
    }

    #[test]
    fn a_plan_that_makes_no_sense_is_refused() {
        let two = surfaces(&[0, 0]);
        let too_few = |unit, found, wanted| {
            Err(SplitError::TooFew {
                unit,
                found,
                wanted,
            })
        };
        assert_eq!(
            random(0.1, true).splits(&two, 0, 0),
            too_few("groups", 1, 2)
        );
        assert_eq!(
            random(0.1, false).splits(&two[..1], 0, 0),
            too_few("surfaces", 1, 2)
        );
        assert_eq!(
            k_fold(3, false).splits(&two, 0, 0),
            too_few("surfaces", 2, 3)
        );
        assert_eq!(
            k_fold(1, false).splits(&two, 0, 0),
            Err(SplitError::Folds(1))
        );
        for share in [0.0, 1.0, -0.5] {
            assert_eq!(
                random(share, false).splits(&two, 0, 0),
                Err(SplitError::Share(share))
            );
        }
        assert!(matches!(
            random(f64::NAN, false).splits(&two, 0, 0),
            Err(SplitError::Share(_))
        ));
    }

    #[test]
    fn groups_larger_than_the_share_still_leave_a_validation_part() {
        let groups = [vec![0; 9], vec![1; 6], vec![2; 7]].concat();
        let split = &random(0.1, true).splits(&surfaces(&groups), 3, 0).unwrap()[0];
        assert_eq!(split.validation, (9..15).collect::<Vec<_>>());
    }

    #[test]
    fn reruns_and_seeds_differ_and_repeat() {
        let all = surfaces(&[0; 50]);
        let draw = |seed, rerun| random(0.1, false).splits(&all, seed, rerun).unwrap();
        assert_eq!(draw(1, 0), draw(1, 0));
        assert_ne!(draw(1, 0), draw(1, 1));
        assert_ne!(draw(1, 0), draw(2, 0));
    }

    proptest! {
        #[test]
        fn a_split_has_every_surface_once_and_keeps_groups(
            groups in prop::collection::vec(0_u8..9, 2..80),
            share in 0.01_f64..0.99,
            keep in any::<bool>(),
            seed in any::<u64>(),
        ) {
            let all = surfaces(&groups);
            let Ok(splits) = random(share, keep).splits(&all, seed, 0) else {
                prop_assert!(keep && groups.iter().all(|group| *group == groups[0]));
                return Ok(());
            };
            let Split { train, validation } = &splits[0];
            let mut both = [train.clone(), validation.clone()].concat();
            both.sort_unstable();
            prop_assert_eq!(both, (0..groups.len()).collect::<Vec<_>>());
            prop_assert!(!train.is_empty() && !validation.is_empty());
            if keep {
                prop_assert!(train.iter().all(|&t| validation.iter().all(|&v| groups[t] != groups[v])));
            } else {
                let wanted = ((groups.len() as f64 * share).round() as usize).clamp(1, groups.len() - 1);
                prop_assert_eq!(validation.len(), wanted);
            }
        }

        #[test]
        fn folds_keep_every_surface_aside_once(
            groups in prop::collection::vec(0_u8..9, 2..80),
            folds in 2_usize..6,
            keep in any::<bool>(),
        ) {
            let all = surfaces(&groups);
            let Ok(splits) = k_fold(folds, keep).splits(&all, 5, 2) else { return Ok(()) };
            prop_assert_eq!(splits.len(), folds);
            let mut aside = splits.iter().flat_map(|split| split.validation.clone()).collect::<Vec<_>>();
            aside.sort_unstable();
            prop_assert_eq!(aside, (0..groups.len()).collect::<Vec<_>>());
            let sizes = splits.iter().map(|split| split.validation.len());
            if !keep {
                prop_assert!(sizes.clone().max().unwrap() - sizes.min().unwrap() <= 1);
            }
            for split in &splits {
                prop_assert!(!keep || split.train.iter().all(
                    |&t| split.validation.iter().all(|&v| groups[t] != groups[v])
                ));
            }
        }
    }
}
