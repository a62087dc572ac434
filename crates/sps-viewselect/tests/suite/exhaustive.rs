//! The true optimum.

use std::sync::Mutex;

use proptest::prelude::*;
use sps_viewselect::{
    Equidistant, Exhaustive, LossError, SelectError, Selector, SetFunction, SetLoss, Sets, VbNvs,
};

use crate::problems::LateFusion;
use crate::support::{all_sets, losses_of, problem, select};

/// A loss of few values, so that there are ties.
fn coarse(seed: u64, levels: u64) -> impl Fn(&[usize]) -> f64 + Sync {
    move |set| {
        let mixed = set.iter().fold(seed | 1, |hash, &view| {
            (hash ^ (view as u64 + 1))
                .wrapping_mul(0x9E37_79B9_7F4A_7C15)
                .rotate_left(31)
        });
        (mixed % levels) as f64 - 2.0
    }
}

proptest! {
    #[test]
    fn equals_brute_force(
        views in 1..7_usize,
        picks in 1..5_usize,
        seed: u64,
        levels in 2..1000_u64,
        distinct: bool,
        block in 1..100_usize,
    ) {
        prop_assume!(picks <= views);
        let function = coarse(seed, levels);
        let sets = all_sets(views, picks, distinct);
        let best = sets.iter().fold(&sets[0], |best, set| {
            if function(set) < function(best) { set } else { best }
        });
        let loss = SetFunction::new(views, picks, &function);
        let exhaustive = Exhaustive { block, ..Exhaustive::default() };
        let problem = problem(&loss).distinct(distinct);
        let found = select(&exhaustive, &problem);
        prop_assert_eq!(&found.picks, best);
        prop_assert_eq!(found.loss, function(best));
        prop_assert_eq!(found.evaluations, sets.len() as u64);
        let mean = sets.iter().map(|set| function(set)).sum::<f64>() / sets.len() as f64;
        let weighted: f64 = found.curve.iter().scan(0, |before, point| {
            let sets = point.evaluations - *before;
            *before = point.evaluations;
            Some(point.mean * sets as f64)
        }).sum();
        prop_assert!((weighted / sets.len() as f64 - mean).abs() < 1e-9 * (1.0 + levels as f64));
    }
}

#[test]
fn equals_brute_force_on_a_late_fusion_estimator() {
    let loss = LateFusion::new(12, 3, 20, 0);
    let sets = all_sets(12, 3, false);
    let losses = losses_of(&loss, &sets.concat());
    let lowest = losses.iter().copied().fold(f64::INFINITY, f64::min);
    let place = losses.iter().position(|&loss| loss == lowest).expect("one");
    let found = select(&Exhaustive::default(), &problem(&loss));
    assert_eq!((&found.picks, found.loss), (&sets[place], lowest));
}

/// Which two of forty thermometers along a rod of length 1 tell its mean temperature? Each reads `x^p`
/// at its place, whose mean is `1 / (p + 1)`: Gauss's two points, 0.211 and 0.789, lie in the cells of
/// thermometers 8 and 31.
#[test]
fn gausss_points_are_found() {
    let loss = SetFunction::new(40, 2, |sensors: &[usize]| {
        let error = |power: i32| {
            let reading = |&sensor: &usize| ((sensor as f64 + 0.5) / 40.0).powi(power);
            let estimate = sensors.iter().map(reading).sum::<f64>() / 2.0;
            (estimate - 1.0 / f64::from(power + 1)).powi(2)
        };
        (1..=3).map(error).sum()
    });
    let problem = problem(&loss).distinct(true).seed(1);
    let optimum = select(&Exhaustive::default(), &problem);
    assert_eq!((optimum.picks, optimum.evaluations), (vec![8, 31], 40 * 39));
    let equidistant = select(&Equidistant::default(), &problem);
    let learned = VbNvs {
        evaluations: 5000,
        ..VbNvs::default()
    };
    let learned = select(&learned, &problem);
    assert!(optimum.loss <= learned.loss && learned.loss < equidistant.loss);
}

/// Keeps the calls that it gets.
struct Recorded(Mutex<Vec<Vec<usize>>>);

impl SetLoss for Recorded {
    fn views(&self) -> usize {
        7
    }

    fn picks(&self) -> usize {
        3
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        losses.fill(1.0);
        let mut calls = self.0.lock().map_err(|_| "another call panicked")?;
        calls.push(sets.as_flat().to_vec());
        Ok(())
    }
}

#[test]
fn blocks_are_whole_runs_in_order_and_bounded() {
    for (block, runs) in [(1, 1), (6, 1), (7, 1), (20, 2), (21, 3), (1000, 49)] {
        let loss = Recorded(Mutex::default());
        let exhaustive = Exhaustive {
            block,
            ..Exhaustive::default()
        };
        select(&exhaustive, &problem(&loss));
        let mut calls = loss.0.into_inner().expect("no call panicked");
        calls.sort();
        assert_eq!(calls.concat(), all_sets(7, 3, false).concat());
        assert!(calls.iter().all(|call| call.len() % 21 == 0));
        let largest = calls.iter().map(|call| call.len() / 21).max();
        assert_eq!(largest, Some(runs), "block {block}");
    }
}

#[test]
fn more_sets_than_allowed_are_refused() {
    let sum = |set: &[usize]| set.iter().sum::<usize>() as f64;
    let four = SetFunction::new(65, 4, sum);
    let error = Exhaustive::default().select(&problem(&four));
    let error = error.expect_err("65^4 sets").to_string();
    let expected = "there are 17850625 sets of 4 of 65 views, expected at most 16777216: raise `limit`, or search";
    assert_eq!(error, expected);
    for (views, picks) in [(5, 3), (12, 2), (125, 1)] {
        let few = SetFunction::new(views, picks, sum);
        let up_to = |limit| Exhaustive {
            limit,
            ..Exhaustive::default()
        };
        let sets = (views as u64).pow(picks as u32);
        let found = select(&up_to(sets), &problem(&few));
        assert_eq!(found.picks, vec![0; picks]);
        // Of distinct views there are fewer, but all are looked at.
        for distinct in [false, true] {
            let refused = up_to(sets - 1).select(&problem(&few).distinct(distinct));
            assert!(matches!(refused, Err(SelectError::TooManySets { .. })));
        }
    }
    // A trillion triples: days, and a curve of gigabytes.
    for picks in [3, 100] {
        let many = SetFunction::new(10_000, picks, sum);
        let refused = Exhaustive::default().select(&problem(&many));
        let refused = refused.expect_err("too many");
        assert!(matches!(refused, SelectError::TooManySets { picks: found, .. } if found == picks));
    }
}
