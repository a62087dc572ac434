//! No split, fold or part that is kept aside takes a group apart, whatever the groups.

use proptest::prelude::*;
use sps_dataset::{KFold, RandomSplit, Split, SplitPlan, Surface, Unit};

fn surfaces(groups: &[u8]) -> Vec<Surface> {
    let surface = |(i, group): (usize, &u8)| Surface {
        id: i.to_string(),
        material: String::new(),
        group: group.to_string(),
    };
    groups.iter().enumerate().map(surface).collect()
}

/// Groups of which at least two differ and at least one has several surfaces.
fn grouped() -> impl Strategy<Value = Vec<u8>> {
    let groups = prop::collection::vec(0_u8..12, 3..90);
    groups.prop_filter("two groups, one of several", |groups| {
        let mut distinct = groups.clone();
        distinct.sort_unstable();
        distinct.dedup();
        distinct.len() > 1 && distinct.len() < groups.len()
    })
}

fn keeping() -> impl Strategy<Value = Option<Unit>> {
    prop_oneof![Just(None), Just(Some(Unit::Group))]
}

/// Every index of `among` is on one side, and no group on both.
fn whole(split: &Split, groups: &[u8], among: &[usize]) -> Result<(), TestCaseError> {
    let mut both = [split.train.clone(), split.validation.clone()].concat();
    both.sort_unstable();
    prop_assert_eq!(both, among);
    for &kept in &split.train {
        for &aside in &split.validation {
            prop_assert_ne!(groups[kept], groups[aside]);
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn plans_keep_groups_whole(
        groups in grouped(),
        by in keeping(),
        share in 0.01_f64..0.99,
        folds in 2_usize..6,
        (seed, rerun) in any::<(u64, u64)>(),
    ) {
        let plans = [
            SplitPlan::Random(RandomSplit { validation: share, by }),
            SplitPlan::KFold(KFold { folds, by }),
            SplitPlan::LeaveOneOut { by },
        ];
        let (all, surfaces): (Vec<usize>, _) = ((0..groups.len()).collect(), surfaces(&groups));
        for plan in plans {
            prop_assert_eq!(plan.units(&surfaces).unit(), Unit::Group);
            // Fewer groups than folds are refused.
            for split in plan.splits(&surfaces, seed, rerun).unwrap_or_default() {
                whole(&split, &groups, &all)?;
            }
        }
    }

    /// Of any part of the surfaces, as calibration, selection and early stopping ask for them.
    #[test]
    fn parts_of_parts_keep_groups_whole(
        groups in grouped(),
        by in keeping(),
        chosen in prop::collection::vec(any::<bool>(), 90),
        share in 0.01_f64..0.99,
        folds in 2_usize..6,
        (seed, index) in any::<(u64, u64)>(),
    ) {
        let units = SplitPlan::LeaveOneOut { by }.units(&surfaces(&groups));
        let some: Vec<usize> = (0..groups.len()).filter(|&i| chosen[i]).collect();
        if let Ok(split) = units.keep_aside(&some, share, seed, "part", index) {
            whole(&split, &groups, &some)?;
        }
        for splits in [units.folds(&some, folds, seed, "part", index), units.each_aside(&some)] {
            let splits = splits.unwrap_or_default();
            let aside = splits.iter().flat_map(|split| split.validation.iter().copied());
            let mut aside: Vec<usize> = aside.collect();
            aside.sort_unstable();
            prop_assert!(splits.is_empty() || aside == some);
            for split in &splits {
                whole(split, &groups, &some)?;
            }
        }
    }

    /// What an interval counts.
    #[test]
    fn a_unit_is_a_group(groups in grouped(), by in keeping()) {
        let units = SplitPlan::LeaveOneOut { by }.units(&surfaces(&groups));
        let of_surface = units.of_surface();
        for (i, first) in groups.iter().enumerate() {
            for (j, second) in groups.iter().enumerate() {
                prop_assert_eq!(first == second, of_surface[i] == of_surface[j]);
            }
        }
        prop_assert!(of_surface.iter().all(|&unit| unit < units.count()));
    }
}
