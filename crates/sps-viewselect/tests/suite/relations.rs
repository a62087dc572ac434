//! Temporal relations: ordered groups of views.

use std::collections::HashMap;

use sps_viewselect::{SelectError, TemporalRelations};

fn settings(scales: &[usize], per_scale: usize) -> TemporalRelations {
    TemporalRelations {
        scales: scales.to_vec(),
        per_scale,
        ..TemporalRelations::default()
    }
}

#[test]
fn groups_are_increasing_distinct_and_as_many_as_asked() {
    let sampler = TemporalRelations::default().sampler(100, 1);
    let sampler = sampler.expect("100 views are enough");
    for step in 0..200 {
        let draw = sampler.training_step(step);
        assert_eq!(draw.len(), 2);
        for (scale, views_per_group) in draw.into_iter().zip([2, 3]) {
            assert_eq!(scale.views_per_group, views_per_group);
            assert_eq!(scale.groups.len(), 3);
            for (place, group) in scale.groups.iter().enumerate() {
                assert_eq!(group.len(), scale.views_per_group);
                assert!(group.is_sorted_by(|a, b| a < b) && group.iter().all(|&view| view < 100));
                assert!(!scale.groups[..place].contains(group));
            }
        }
    }
}

#[test]
fn every_group_is_equally_likely() {
    // 10 pairs of 5; chi-square with 9 degrees of freedom is below 27.9 with probability 0.999.
    let sampler = settings(&[2], 1).sampler(5, 4).expect("five views");
    let mut counts = HashMap::<Vec<usize>, f64>::new();
    for step in 0..10_000 {
        let group = sampler.training_step(step)[0].groups[0].clone();
        *counts.entry(group).or_default() += 1.0;
    }
    assert_eq!(counts.len(), 10);
    let terms = counts.values().map(|count| (count - 1000.0).powi(2));
    let chi_square = terms.sum::<f64>() / 1000.0;
    assert!(chi_square < 27.9, "{chi_square}");
}

#[test]
fn a_scale_with_few_groups_gives_all_of_them() {
    let sampler = settings(&[2, 3, 4], 10).sampler(4, 0).expect("four views");
    let draw = sampler.training_step(9);
    let pairs: [&[usize]; 6] = [&[0, 1], &[0, 2], &[0, 3], &[1, 2], &[1, 3], &[2, 3]];
    assert_eq!(draw[0].groups, pairs);
    let triples: [&[usize]; 4] = [&[0, 1, 2], &[0, 1, 3], &[0, 2, 3], &[1, 2, 3]];
    assert_eq!(draw[1].groups, triples);
    assert_eq!(draw[2].groups, [[0, 1, 2, 3]]);
}

#[test]
fn draws_depend_on_seed_and_step_and_test_draws_are_their_own() {
    let sampler = |seed| {
        let sampler = TemporalRelations::default().sampler(100, seed);
        sampler.expect("views enough")
    };
    let first = sampler(1);
    assert_eq!(first.training_step(5), sampler(1).training_step(5));
    assert_ne!(first.training_step(5), first.training_step(6));
    assert_ne!(first.training_step(5), sampler(2).training_step(5));
    let training: Vec<_> = (0..50).map(|step| first.training_step(step)).collect();
    assert_eq!(first.test_draws().count(), 10);
    assert!(first.test_draws().all(|draw| !training.contains(&draw)));
}

#[test]
fn scales_that_do_not_fit_are_refused() {
    let refused = |scales: &[usize], views| {
        let sampler = settings(scales, 1).sampler(views, 0);
        sampler.expect_err("scales that do not fit")
    };
    let many = refused(&[2, 3], 2);
    assert!(matches!(many, SelectError::TooManyPicks { views, picks } if (views, picks) == (2, 3)));
    assert!(matches!(refused(&[0], 2), SelectError::NoPicks));
    assert!(matches!(refused(&[1], 0), SelectError::NoViews));
    let no_draws = TemporalRelations {
        test_draws: 0,
        ..TemporalRelations::default()
    };
    for (field, settings) in [
        ("scales", settings(&[], 1)),
        ("per-scale", settings(&[2], 0)),
        ("test-draws", no_draws),
    ] {
        let error = settings.sampler(9, 0).expect_err("a setting out of range");
        assert!(matches!(error, SelectError::Setting { field: found, .. } if found == field));
    }
}
