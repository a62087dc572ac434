//! Intervals that promise to cover.

use proptest::prelude::*;
use sps_metrics::{
    ConformalError, Level, PredictionInterval, Quantity, SplitConformal, Undefined, coverage,
};

use crate::support::{level, uniform};

/// ceil((n + 1) level) in integers.
fn exact_rank(calibration: usize, thousandths: usize) -> usize {
    ((calibration + 1) * thousandths).div_ceil(1000)
}

#[test]
fn the_rank_is_that_of_integer_arithmetic() {
    let residuals: Vec<f64> = (1..=1200).map(f64::from).collect();
    for calibration in 1..residuals.len() {
        for thousandths in [
            1, 100, 333, 500, 550, 683, 700, 800, 900, 950, 955, 990, 999,
        ] {
            let rank = exact_rank(calibration, thousandths);
            let level = level(thousandths);
            match SplitConformal::from_residuals(&residuals[..calibration], level) {
                // The residuals are 1, 2, ..., so the radius is its own rank.
                Ok(conformal) => assert_eq!(conformal.radius, rank as f64),
                Err(ConformalError::TooFewSamples { found, needed, .. }) => {
                    assert!(rank > calibration && found == calibration);
                    let least = (1..=1000).find(|&n| exact_rank(n, thousandths) <= n);
                    assert_eq!(Some(needed), least, "{thousandths}");
                }
                Err(error) => panic!("{error}"),
            }
        }
    }
}

proptest! {
    /// Of n + 1 exchangeable residuals, each left out in turn, exactly `rank` are covered by the
    /// others: the theorem itself, without a simulation.
    #[test]
    fn leaving_each_out_covers_exactly_the_promise(
        residuals in prop::collection::hash_set(1_u32..1_000_000, 12..60),
        thousandths in 50_usize..917, // eleven samples reach 11 / 12
    ) {
        let residuals: Vec<f64> = residuals.into_iter().map(f64::from).collect();
        let mut covered = 0;
        let mut promised = 0.0;
        for index in 0..residuals.len() {
            let mut others = residuals.clone();
            let left_out = others.swap_remove(index);
            let conformal = SplitConformal::from_residuals(&others, level(thousandths));
            let conformal = conformal.expect("enough samples");
            promised = conformal.expected_coverage();
            covered += usize::from(left_out <= conformal.radius);
        }
        let fraction = covered as f64 / residuals.len() as f64;
        prop_assert_eq!(fraction, promised);
        prop_assert!(promised >= thousandths as f64 / 1000.0 - 1e-12);
        prop_assert!(promised < thousandths as f64 / 1000.0 + 1.0 / residuals.len() as f64);
    }
}

/// 2000 calibrations on 49 samples each, 50 new samples each: coverage averages 45 / 50 with a
/// standard error below 0.002.
#[test]
fn new_samples_are_covered_at_the_promised_rate() {
    let mut numbers = uniform("conformal");
    let mut covered = 0;
    let mut samples = 0;
    for _ in 0..2000 {
        let residuals: Vec<f64> = numbers.by_ref().take(49).map(|u| u * u * u).collect();
        let conformal = SplitConformal::from_residuals(&residuals, Level::P90);
        let conformal = conformal.expect("enough samples");
        let truth: Vec<f64> = numbers.by_ref().take(50).map(|u| 7.0 + u * u * u).collect();
        let intervals = vec![PredictionInterval::around(7.0, conformal.radius); truth.len()];
        let seen = coverage(&intervals, &truth).expect("as many intervals as truths");
        assert!((seen.mean_width - 2.0 * conformal.radius).abs() < 1e-12);
        covered += seen.covered;
        samples += seen.samples;
    }
    let fraction = covered as f64 / samples as f64;
    assert!((fraction - 0.9).abs() < 0.006, "{fraction}");
}

#[test]
fn the_sign_of_a_residual_does_not_matter() {
    let half = level(500);
    let conformal = SplitConformal::from_residuals(&[-1.0, 2.0, -0.5], half);
    let conformal = conformal.expect("three samples");
    assert_eq!((conformal.radius, conformal.samples), (1.0, 3));
    assert_eq!(conformal.level, half);
    let PredictionInterval { low, high } = PredictionInterval::around(5.0, conformal.radius);
    assert_eq!((low, high), (4.0, 6.0));

    let refused = SplitConformal::from_residuals(&[1.0, f64::NAN], half);
    let named = matches!(
        refused,
        Err(ConformalError::Undefined(Undefined::NonFinite {
            quantity: Quantity::Residual,
            index: 1,
            ..
        }))
    );
    assert!(named, "{refused:?}");
}

#[test]
fn coverage_counts_ends_and_refuses_nonsense() {
    let interval = |low, high| PredictionInterval { low, high };
    let unit = interval(0.0, 1.0);
    let intervals = [unit, unit, unit, interval(2.0, 2.0)];
    let seen = coverage(&intervals, &[0.0, 1.0, 1.5, 2.0]).expect("four of each");
    assert_eq!((seen.covered, seen.samples), (3, 4));
    assert_eq!((seen.fraction(), seen.mean_width), (0.75, 0.75));

    let inverted = [unit, interval(3.0, 2.0)];
    let refused = coverage(&inverted, &[0.5, 2.5]);
    assert_eq!(refused, Err(Undefined::InvertedInterval { index: 1 }));
    assert_eq!(coverage(&[], &[]), Err(Undefined::Empty));
    assert!(coverage(&inverted, &[0.5]).is_err());
    let endless = [interval(0.0, f64::INFINITY)];
    let reason = coverage(&endless, &[1.0]).expect_err("it has no end");
    assert!(reason.to_string().starts_with("interval 0 is infinite"));
    let wide = [interval(-f64::MAX, f64::MAX)];
    assert_eq!(coverage(&wide, &[1.0]), Err(Undefined::OutOfRange));
}
