//! Sums that lose their digits.

use std::hint::black_box;

use sps_metrics::{Moments, Pair, ScoreAccumulator, Undefined};

use super::{naive, within};
use crate::support::{
    AT_1E8, Exact, UNIT, Units, assert_close, merged, relative_error, samples, training_mean, value,
};

/// Sample i of truths spread over two units above 1e8, to the last place of an `f64`, with errors
/// of up to half a unit.
fn near_1e8(i: i64) -> Units {
    // Odd multipliers, so that the remainders visit every value.
    let truth = AT_1E8 + (i * 2_654_435_761) % (1 << 27);
    Units {
        truth,
        estimate: truth + (i * 40_503_001) % (1 << 26) - (1 << 25),
    }
}

fn apart(units: impl Iterator<Item = Units>) -> (Vec<f64>, Vec<f64>) {
    units
        .map(Units::pair)
        .map(|pair| (pair.truth, pair.estimate))
        .unzip()
}

#[test]
fn truths_at_1e8_keep_every_digit_of_r2() {
    let exact: Exact = (0..4096).map(near_1e8).collect();
    let (truth, estimate) = apart((0..4096).map(near_1e8));
    let scored = samples(&truth, &estimate);
    let own = exact.r2_own_mean();
    let silent = naive::r2_of_sums(&truth, &estimate);
    let found = value(&scored.r2_own_mean());
    within("R² of truths at 1e8", found, own, 5e-16, silent);
    let mean = AT_1E8 + 70_000_001;
    let about = training_mean(mean as f64 * UNIT);
    assert_close(value(&scored.r2(about)), exact.r2(mean), 5e-16);
}

#[test]
fn variance_at_1e8_survives_any_order() {
    let exact: Exact = (0..4096).map(near_1e8).collect();
    let (mut truth, _) = apart((0..4096).map(near_1e8));
    let degrees = (truth.len() - 1) as f64;
    let mut worst_naive = exact.variance();
    let mut worst = exact.variance();
    let further = |one: f64, other: f64| {
        let error = |variance| relative_error(variance, exact.variance());
        let is_worse = error(one) > error(other);
        if is_worse { one } else { other }
    };
    for _ in 0..8 {
        truth.rotate_left(511);
        truth.reverse();
        let (left, right) = truth.split_at(truth.len() / 3);
        let mut moments: Moments = right.iter().copied().collect();
        moments.merge(&left.iter().copied().collect());
        let variance = moments.sample_variance().expect("two values");
        worst = further(variance, worst);
        let welford = naive::welford_squares(truth.iter().copied()) / degrees;
        worst_naive = further(welford, worst_naive);
    }
    let case = "variance of truths at 1e8, any order";
    within(case, worst, exact.variance(), 5e-16, worst_naive);
}

#[test]
fn spread_of_a_unit_in_the_last_place_is_seen() {
    // 1e8 and its two neighbours: variance of one ulp squared, exactly.
    let ulp = 2f64.powi(-26);
    let moments: Moments = [1e8 - ulp, 1e8, 1e8 + ulp].into_iter().collect();
    assert_eq!(moments.sample_variance(), Ok(ulp * ulp));
    assert_eq!(moments.mean(), Ok(1e8));
    let truth = [1e8 - ulp, 1e8, 1e8 + ulp];
    assert!(!(naive::r2_of_sums(&truth, &[1e8; 3]) == 0.0));
    assert_eq!(value(&samples(&truth, &[1e8; 3]).r2_own_mean()), 0.0);
}

#[test]
fn an_outlier_does_not_drown_the_rest() {
    // Origin 1e12, then 2^20 values alternating by one unit: the squares about the first value are
    // n times those about the mean.
    let values = || (0..1 << 20).map(|i| if i == 0 { 1 << 50 } else { i & 1 });
    let units = || {
        values().map(|truth| Units {
            truth,
            estimate: truth,
        })
    };
    let exact: Exact = units().collect();
    let moments: Moments = units().map(|units| units.pair().truth).collect();
    let truth: Vec<f64> = units().map(|units| units.pair().truth).collect();
    let n = truth.len() as f64;
    let shifted: Vec<f64> = truth.iter().map(|t| t - truth[0]).collect();
    let sum: f64 = shifted.iter().sum();
    let squares: f64 = shifted.iter().map(|d| d * d).sum();
    let shifted_in_f64 = (squares - sum * sum / n) / (n - 1.0);
    let variance = moments.sample_variance().expect("two values");
    let case = "variance beside an outlier";
    within(case, variance, exact.variance(), 5e-16, shifted_in_f64);
}

#[test]
fn r2_near_zero_keeps_its_digits() {
    // Every error as large as its truth, but one that is a unit smaller: an R² of 8e-10, which
    // 1 - ratio knows to seven digits.
    const COUNT: i64 = 3001;
    const SIZE: i64 = 3 << 18;
    let units = |i: i64| Units {
        truth: SIZE,
        estimate: i64::from(i == 0),
    };
    let exact: Exact = (0..COUNT).map(units).collect();
    let (truth, estimate) = apart((0..COUNT).map(units));
    let about_zero = exact.r2(0);
    assert!(about_zero > 0.0 && about_zero < 1e-9);
    let found = samples(&truth, &estimate).r2(training_mean(0.0));
    let rounded_first = naive::r2(&truth, &estimate, 0.0);
    let found = value(&found);
    within("R² near zero", found, about_zero, 5e-16, rounded_first);
}

#[test]
fn ten_million_streamed_values_match_exact_integers() {
    const COUNT: i64 = 10_000_000;
    let units = || (0..COUNT).map(near_1e8);
    let exact: Exact = units().collect();
    // In one go, and in seven parts merged backwards: no square leaves 3, 5 or 6, so three are empty.
    let whole: ScoreAccumulator = units().map(Units::pair).collect();
    let mut parts = vec![ScoreAccumulator::new(); 7];
    for (i, units) in units().enumerate() {
        parts[(i * i) % 7].push(units.pair());
    }
    let merged = merged(parts.iter().rev());
    let mean = AT_1E8 + 70_000_001;
    for sums in [&whole, &merged] {
        assert_close(value(&sums.r2_own_mean()), exact.r2_own_mean(), 5e-16);
        let about = training_mean(mean as f64 * UNIT);
        assert_close(value(&sums.r2(about)), exact.r2(mean), 5e-16);
        assert_close(value(&sums.mae()), exact.mae(), 5e-16);
        assert_close(value(&sums.rmse()), exact.rmse(), 5e-16);
        assert_eq!(sums.samples(), Ok(COUNT as usize));
    }
    let welford = naive::welford_squares(units().map(|units| units.pair().truth));
    let welford = welford / (COUNT - 1) as f64;
    let moments: Moments = units().map(|units| units.pair().truth).collect();
    let variance = moments.sample_variance().expect("two values");
    let case = "variance of 1e7 streamed values";
    within(case, variance, exact.variance(), 5e-16, welford);
}

#[test]
fn ten_million_equal_errors_average_to_themselves() {
    const COUNT: usize = 10_000_000;
    let pair = Pair {
        truth: 0.0,
        estimate: 0.1,
    };
    let sums: ScoreAccumulator = std::iter::repeat_n(pair, COUNT).collect();
    let running: f64 = std::iter::repeat_n(black_box(0.1), COUNT).sum();
    let running = running / COUNT as f64;
    within("1e7 equal errors", value(&sums.mae()), 0.1, 0.0, running);
    assert_eq!(value(&sums.rmse()), 0.1);
}

#[test]
fn squares_beyond_f64_are_out_of_range() {
    // Of errors and truths that are finite: inf / inf and 0 / 0 in the naive form.
    for size in [1e200, 1e-200] {
        let (truth, estimate) = ([-size, size], [-0.9 * size, 0.9 * size]);
        let scored = samples(&truth, &estimate);
        assert_eq!(scored.r2_own_mean(), Err(Undefined::OutOfRange));
        assert_eq!(scored.r2(training_mean(0.0)), Err(Undefined::OutOfRange));
        assert_eq!(scored.rmse(), Err(Undefined::OutOfRange));
        assert_close(value(&scored.mae()), 0.1 * size, 1e-15);
        assert!(naive::r2(&truth, &estimate, 0.0).is_nan());
    }
    // Squares that are denormal: finite, and wrong in the seventh digit.
    let (truth, estimate) = ([-1e-158, 1e-158], [-0.7e-158, 0.7e-158]);
    let outcome = samples(&truth, &estimate).r2(training_mean(0.0));
    assert_eq!(outcome, Err(Undefined::OutOfRange));
    let silent = naive::r2(&truth, &estimate, 0.0);
    assert!(relative_error(silent, 0.91) > 1e-9);
    // Within the range it says is safe.
    for size in [1e140, 1e-140] {
        let scored = samples(&[-size, size], &[-0.5 * size, 0.5 * size]).r2_own_mean();
        assert_close(value(&scored), 0.75, 1e-15);
    }
}
