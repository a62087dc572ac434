//! Intervals from awkward samples.

use sps_metrics::{
    ConformalError, IntervalError, Intervals, Level, Metric, Scored, SplitConformal,
};

use super::naive;
use crate::support::{assert_close, level, relative_error, samples, uniform};

#[test]
fn equal_truths_that_are_left_are_not_scored() {
    // Seven photographs each of a surface of 0.1 and one of 0.5: without either all truths are equal.
    // The mean of seven equal truths is not one of them in f64, which would give the rest an R² below
    // -1e28.
    let (truth, estimate) = ([[0.1; 7], [0.5; 7]].concat(), [0.3; 14]);
    let surfaces = [[0; 7], [1; 7]].concat();
    let found = Intervals::of_models(Level::P95).interval(&[Scored {
        units: Some(&surfaces),
        ..Scored::new(Metric::R2OwnMean, samples(&truth, &estimate))
    }]);
    assert_eq!(found, Err(IntervalError::OneUnit));
    let drawn = [0.1; 7];
    let silent = naive::r2(&drawn, &[0.3; 7], naive::mean(&drawn));
    assert!(silent.is_finite() && silent < -1e28);
}

#[test]
fn interval_at_1e8_equals_interval_at_zero() {
    // Truths a few units in the last place apart: 1e8 + k ulp scores as k does, whichever is left out.
    const ULP: f64 = 1.0 / 67_108_864.0; // of 1e8: 2^-26
    let whole = |name: &str| {
        let numbers = uniform(name).map(|u| (u * 8.0).round());
        numbers.take(100).collect::<Vec<f64>>()
    };
    let (truth, errors) = (whole("hard/truth"), whole("hard/errors"));
    let estimate: Vec<f64> = truth.iter().zip(&errors).map(|(t, e)| t + e).collect();
    let interval = |offset: f64, scale: f64| {
        let moved = |values: &[f64]| -> Vec<f64> {
            values.iter().map(|value| offset + scale * value).collect()
        };
        let (truth, estimate) = (moved(&truth), moved(&estimate));
        let scored = Scored::new(Metric::R2OwnMean, samples(&truth, &estimate));
        let found = Intervals::of_models(Level::P95).interval(&[scored]);
        let silent = naive::r2(&truth, &estimate, naive::mean(&truth));
        (found.expect("100 surfaces"), silent)
    };
    let ((here, naive_here), (there, naive_there)) = (interval(0.0, 1.0), interval(1e8, ULP));
    assert_close(there.low, here.low, 1e-13);
    assert_close(there.high, here.high, 1e-13);
    let error = relative_error(there.low, here.low).max(relative_error(there.high, here.high));
    let naive = relative_error(naive_there, naive_here);
    println!("interval at 1e8: error {error:.1e}, bound 1e-13, naive form {naive:.1e}");
    assert!(naive > 1e-6);
}

#[test]
fn conformal_rank_is_not_lost_to_rounding() {
    // 0.55 * 100 is 55.00000000000001 in f64, whose ceiling is one rank too far.
    let residuals: Vec<f64> = (1..100).map(f64::from).collect();
    let conformal = SplitConformal::from_residuals(&residuals, level(550));
    assert_eq!(conformal.map(|conformal| conformal.radius), Ok(55.0));
    assert_eq!((100.0_f64 * 0.55).ceil(), 56.0);
}

#[test]
fn too_few_samples_for_a_level_make_no_interval() {
    // The largest of eight residuals covers with 8/9 only. The uncorrected quantile hides it.
    let residuals = [1.0; 8];
    let refused = SplitConformal::from_residuals(&residuals, Level::P90);
    let reason = ConformalError::TooFewSamples {
        found: 8,
        needed: 9,
        level: Level::P90,
    };
    assert_eq!(refused, Err(reason));
    assert!((0.9 * residuals.len() as f64).ceil() as usize <= residuals.len());
}
