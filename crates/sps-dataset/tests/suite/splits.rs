//! How a config says what a split keeps together, and that units are drawn fairly.

use sps_dataset::{KFold, RandomSplit, SplitPlan, Surface, Unit, Units, parse_toml};

fn surface(id: usize, material: &str, group: &str) -> Surface {
    Surface {
        id: id.to_string(),
        material: material.to_owned(),
        group: group.to_owned(),
    }
}

/// One group for each size, with so many surfaces.
fn groups_of(sizes: &[usize]) -> Vec<Surface> {
    let groups = sizes.iter().enumerate();
    let named = groups.flat_map(|(group, &size)| vec![group.to_string(); size]);
    named
        .enumerate()
        .map(|(at, group)| surface(at, "", &group))
        .collect()
}

/// Chi-squared over the groups of how often each is kept aside, with `n` seeds and `k` of `G` groups
/// drawn without replacement:
///
/// ```text
/// (G - 1) / G * sum_g (count_g - n k / G)^2 / (n k / G (1 - k / G)),
/// ```
///
/// which has `G - 1` degrees of freedom where every group is as likely. 52.6 is the 99.9 % point of 25
/// degrees: a fair rule fails for one choice of seeds in a thousand. A rule that takes groups to fill a share
/// of the surfaces never takes the first one: it has 617, about its own mean number of groups.
#[test]
fn a_group_is_kept_aside_as_often_as_any_other_whatever_its_size() {
    let sizes = [vec![100], vec![20; 5], vec![5; 20]].concat();
    let surfaces = groups_of(&sizes);
    let units = Units::of(&surfaces);
    let (all, seeds) = ((0..surfaces.len()).collect::<Vec<_>>(), 2000);
    let mut counts = vec![0.0_f64; sizes.len()];
    for seed in 0..seeds {
        let split = units.keep_aside(&all, 0.1, seed, "split", 0).unwrap();
        let mut aside: Vec<usize> = split
            .validation
            .iter()
            .map(|&at| units.of_surface()[at])
            .collect();
        aside.dedup();
        // A tenth of 26 groups.
        assert_eq!(aside.len(), 3);
        for group in aside {
            counts[group] += 1.0;
        }
    }
    let (groups, share) = (sizes.len() as f64, 3.0 / sizes.len() as f64);
    let expected = seeds as f64 * share;
    let squares = counts.iter().map(|count| (count - expected).powi(2));
    let chi2 = squares.sum::<f64>() / (expected * (1.0 - share)) * (groups - 1.0) / groups;
    assert!(chi2 < 52.6, "{chi2}, {counts:?}");
}

/// As drawn before units were drawn by their number: results of single surfaces depend on it.
#[test]
fn single_surfaces_are_drawn_as_they_always_were() {
    let surfaces = groups_of(&[1; 12]);
    let units = Units::of(&surfaces);
    let all: Vec<usize> = (0..12).collect();
    let aside = |share, seed, purpose, index| {
        let split = units.keep_aside(&all, share, seed, purpose, index);
        split.unwrap().validation
    };
    assert_eq!(aside(0.3, 7, "random split", 0), [2, 4, 8, 10]);
    assert_eq!(aside(0.3, 7, "random split", 3), [0, 6, 7, 8]);
    assert_eq!(aside(0.01, 7, "early stopping", 1), [10]);
    let folds = units.folds(&all, 3, 7, "folds", 1).unwrap();
    let folds: Vec<_> = folds.into_iter().map(|split| split.validation).collect();
    let dealt = [[3, 9, 10, 11], [4, 5, 7, 8], [0, 1, 2, 6]];
    assert_eq!(folds, dealt);
}

#[test]
fn materials_stay_together_and_a_surface_without_one_is_its_own() {
    let materials = ["oak", "", "denim", "oak", "", "denim"];
    let surfaces = materials.iter().enumerate();
    let surfaces: Vec<Surface> = surfaces
        .map(|(at, material)| surface(at, material, "all"))
        .collect();
    let units = Units::by(&surfaces, Unit::Material);
    assert_eq!((units.unit(), units.count()), (Unit::Material, 4));
    assert_eq!(units.of_surface(), [0, 1, 2, 0, 3, 2]);
    // An empty group is none, too.
    let alone = [surface(0, "", ""), surface(1, "", "")];
    assert_eq!(Units::by(&alone, Unit::Group).of_surface(), [0, 1]);
    assert_eq!(Units::of(&alone).unit(), Unit::Surface);

    let plan = SplitPlan::LeaveOneOut {
        by: Some(Unit::Material),
    };
    let splits = plan.splits(&surfaces, 0, 0).unwrap();
    let aside: Vec<_> = splits.into_iter().map(|split| split.validation).collect();
    assert_eq!(aside, [vec![0, 3], vec![1], vec![2, 5], vec![4]]);
    let one = [surface(0, "oak", "a"), surface(1, "oak", "b")];
    let refused = plan.splits(&one, 0, 0).unwrap_err().to_string();
    assert_eq!(refused, "1 materials cannot be split into 2 parts");
}

fn read(text: &str) -> Result<SplitPlan, String> {
    #[derive(serde::Deserialize)]
    struct Config {
        split: SplitPlan,
    }
    let config = parse_toml::<Config>("config.toml".as_ref(), text);
    config.map(|config| config.split).map_err(|e| e.to_string())
}

#[test]
fn a_config_says_what_is_kept_together() {
    let random = |by| {
        SplitPlan::Random(RandomSplit {
            validation: 0.2,
            by,
        })
    };
    let folds = |folds, by| SplitPlan::KFold(KFold { folds, by });
    let out = |by| SplitPlan::LeaveOneOut { by };
    let (surface, group) = (Some(Unit::Surface), Some(Unit::Group));
    let material = Some(Unit::Material);
    for (text, plan) in [
        ("random]\nvalidation = 0.2", random(None)),
        (
            "random]\nvalidation = 0.2\nby = \"surface\"",
            random(surface),
        ),
        ("k-fold]", folds(10, None)),
        ("k-fold]\nfolds = 5\nby = \"material\"", folds(5, material)),
        ("leave-one-out]", out(None)),
        ("leave-one-out]\nby = \"material\"", out(material)),
        ("leave-one-out]\nby = \"group\"", out(group)),
    ] {
        assert_eq!(read(&format!("[split.{text}")), Ok(plan), "{text}");
    }
    assert_eq!(read("[split.random]"), Ok(SplitPlan::default()));
}

#[test]
fn a_config_that_says_it_wrong_is_told_what_is_right() {
    for (text, parts) in [
        (
            "random]\nby = \"surface\"\nkeep-groups = false",
            &["line 3", "`by`", "`keep-groups`"][..],
        ),
        ("k-fold]\nby = \"kind\"", &["line 2", "kind", "material"]),
        ("k-fold]\nfold = 3", &["line 2", "`fold`", "`folds`"]),
        ("leave-one-out]\nkeep-groups = true", &["line 2", "`by`"]),
        ("leave-one-outs]", &["leave-one-outs", "leave-one-out"]),
    ] {
        let message = read(&format!("[split.{text}")).unwrap_err();
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }
}
