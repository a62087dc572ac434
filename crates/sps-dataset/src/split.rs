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

    fn random(validation: f64, keep: bool) -> SplitPlan {
        SplitPlan::Random(RandomSplit {
            validation,
            by: Some(kept(keep)),
        })
    }

    fn k_fold(folds: usize, keep: bool) -> SplitPlan {
        SplitPlan::KFold(KFold {
            folds,
            by: Some(kept(keep)),
        })
    }

    fn kept(keep: bool) -> Unit {
        if keep { Unit::Group } else { Unit::Surface }
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
            too_few(Unit::Group, 1, 2)
        );
        assert_eq!(
            random(0.1, false).splits(&two[..1], 0, 0),
            too_few(Unit::Surface, 1, 2)
        );
        assert_eq!(
            k_fold(3, false).splits(&two, 0, 0),
            too_few(Unit::Surface, 2, 3)
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
        let all = surfaces(&groups);
        for seed in 0..20 {
            let split = &random(0.1, true).splits(&all, seed, 0).unwrap()[0];
            let of_group = groups[split.validation[0]];
            let members: Vec<usize> = (0..22).filter(|&i| groups[i] == of_group).collect();
            assert_eq!(split.validation, members);
        }
    }

    #[test]
    fn reruns_and_seeds_differ_and_repeat() {
        let all = surfaces(&[0; 50]);
        let draw = |seed, rerun| random(0.1, false).splits(&all, seed, rerun).unwrap();
        assert_eq!(draw(1, 0), draw(1, 0));
        assert_ne!(draw(1, 0), draw(1, 1));
        assert_ne!(draw(1, 0), draw(2, 0));
    }

    #[test]
    fn groups_are_kept_where_any_has_several_surfaces() {
        let plan = SplitPlan::default();
        assert_eq!(plan.units(&surfaces(&[0, 1, 2])).unit(), Unit::Surface);
        assert_eq!(plan.units(&surfaces(&[0, 1, 1])).unit(), Unit::Group);
        assert_eq!(plan.units(&surfaces(&[0, 1, 1])).of_surface(), [0, 1, 1]);
        assert_eq!(
            random(0.1, false).units(&surfaces(&[0, 1, 1])).unit(),
            Unit::Surface
        );
    }

    #[test]
    fn leave_one_group_out_holds_each_group_out_once() {
        let plan = SplitPlan::LeaveOneOut {
            by: Some(Unit::Group),
        };
        let splits = plan.splits(&surfaces(&[5, 3, 5, 8]), 1, 0).unwrap();
        let held: Vec<_> = splits
            .iter()
            .map(|split| split.validation.clone())
            .collect();
        assert_eq!(held, [vec![0, 2], vec![1], vec![3]]);
        assert_eq!(splits[0].train, [1, 3]);
        assert_eq!(
            plan.splits(&surfaces(&[0, 0]), 1, 0),
            Err(SplitError::TooFew {
                unit: Unit::Group,
                found: 1,
                wanted: 2
            })
        );
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
