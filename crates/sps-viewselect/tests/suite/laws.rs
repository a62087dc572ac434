//! What holds of every selector on every problem.

use std::sync::atomic::{AtomicU64, Ordering};

use proptest::prelude::*;
use sps_viewselect::{Equidistant, EquidistantAt, Nadir, Random, SetFunction};

use crate::problems::LateFusion;
use crate::support::{all_selectors, losses_of, problem, select, select_on};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn reports_are_true(
        views in 1..9_usize,
        picks in 1..5_usize,
        index in 0..1000_u64,
        distinct: bool,
    ) {
        prop_assume!(picks <= views);
        let fusion = LateFusion::new(views, picks, 5, index);
        let asked = AtomicU64::new(0);
        let loss = SetFunction::new(views, picks, |set: &[usize]| {
            asked.fetch_add(1, Ordering::Relaxed);
            losses_of(&fusion, set)[0]
        });
        let problem = problem(&loss).seed(index).distinct(distinct);
        for (name, selector) in all_selectors() {
            let selection = select(&*selector, &problem);
            prop_assert_eq!(asked.swap(0, Ordering::Relaxed), selection.computed, "{}", name);
            prop_assert!(selection.computed <= selection.evaluations);
            prop_assert_eq!(selection.picks.len(), picks);
            prop_assert!(selection.picks.iter().all(|&view| view < views));
            let mut sorted = selection.picks.clone();
            sorted.sort_unstable();
            sorted.dedup();
            prop_assert!(!distinct || sorted.len() == picks, "{}: {:?}", name, selection.picks);
            prop_assert_eq!(selection.loss, losses_of(&fusion, &selection.picks)[0]);
            let last = selection.curve.last().expect("at least one round");
            prop_assert_eq!(last.evaluations, selection.evaluations);
            prop_assert!(last.best <= selection.loss);
            let curve = selection.curve;
            let forward = curve.is_sorted_by(|a, b| a.evaluations < b.evaluations && a.best >= b.best);
            prop_assert!(forward, "{}", name);
            prop_assert!(curve.iter().all(|point| point.mean >= point.best - 1e-12));
            prop_assert!(selection.seconds >= 0.0);
        }
    }

    #[test]
    fn equidistant_views_mirror_themselves(views in 1..200_usize, picks in 1..200_usize) {
        prop_assume!(picks <= views);
        let loss = SetFunction::new(views, picks, |_: &[usize]| 0.0);
        for at in [EquidistantAt::Centres, EquidistantAt::Ends] {
            let set = select(&Equidistant { at }, &problem(&loss)).picks;
            prop_assert!(set.is_sorted_by(|a, b| a < b));
            // Mirrored they are the same, but for the rounding of halves.
            for (one, other) in set.iter().zip(set.iter().rev()) {
                let sum = one + other;
                prop_assert!(sum + 1 == views || sum + 2 == views, "{:?}", set);
            }
            // Neighbours are one interval apart, rounded.
            let interval = match at {
                EquidistantAt::Centres => views as f64 / picks as f64,
                EquidistantAt::Ends => (views as f64 - 1.0) / (picks as f64 - 1.0),
            };
            for pair in set.windows(2) {
                let apart = (pair[1] - pair[0]) as f64;
                prop_assert!((apart - interval).abs() < 1.0, "{:?}", set);
            }
            let first_and_last = [set[0], set[set.len() - 1]] == [0, views - 1];
            prop_assert!(at == EquidistantAt::Centres || picks == 1 || first_and_last);
        }
    }
}

/// By hand: the middle of part i of M is (2i + 1) N / 2M - 1/2, and place i from end to end
/// i (N - 1) / (M - 1), both rounded half down.
#[test]
fn equidistant_views_are_where_they_should_be() {
    let cases: [(usize, &[usize], &[usize]); 8] = [
        (21, &[3, 10, 17], &[0, 10, 20]),
        (100, &[16, 49, 83], &[0, 49, 99]),
        (10, &[1, 3, 6, 8], &[0, 3, 6, 9]),
        (5, &[0, 1, 3, 4], &[0, 1, 3, 4]),
        (100, &[24, 74], &[0, 99]),
        (100, &[49], &[49]),
        (21, &[10], &[10]),
        (4, &[0, 1, 2, 3], &[0, 1, 2, 3]),
    ];
    for (views, centres, ends) in cases {
        let loss = SetFunction::new(views, centres.len(), |_: &[usize]| 0.0);
        let picks = |at| select(&Equidistant { at }, &problem(&loss)).picks;
        assert_eq!(picks(EquidistantAt::Centres), centres, "of {views}");
        assert_eq!(picks(EquidistantAt::Ends), ends, "of {views}");
    }
    assert_eq!(Equidistant::default().at, EquidistantAt::Centres);
}

#[test]
fn fixed_selections_are_where_they_should_be() {
    let three = SetFunction::new(100, 3, |_: &[usize]| 0.0);
    let nadir = Nadir::default();
    assert_eq!(select(&nadir, &problem(&three)).picks, [49, 49, 49]);
    let distinct = problem(&three).distinct(true);
    assert_eq!(select(&nadir, &distinct).picks, [49, 48, 50]);
    let edge = Nadir { view: Some(99) };
    assert_eq!(select(&edge, &distinct).picks, [99, 98, 97]);
}

#[test]
fn seeds_and_draws_matter() {
    let loss = LateFusion::new(50, 3, 5, 0);
    let picks = |seed, draws| select(&Random { draws }, &problem(&loss).seed(seed));
    assert_eq!(picks(1, 1).picks, picks(1, 1).picks);
    assert_ne!(picks(1, 1).picks, picks(2, 1).picks);
    assert!(picks(1, 500).loss < picks(1, 1).loss);
}

#[test]
fn selections_do_not_depend_on_the_number_of_threads() {
    let loss = LateFusion::new(20, 3, 10, 3);
    for distinct in [false, true] {
        let problem = problem(&loss).seed(11).distinct(distinct);
        for (name, selector) in all_selectors() {
            let one = select_on(1, &*selector, &problem);
            for threads in [2, 5] {
                let found = select_on(threads, &*selector, &problem);
                assert_eq!(one, found, "{name} on {threads} threads");
            }
        }
    }
}
