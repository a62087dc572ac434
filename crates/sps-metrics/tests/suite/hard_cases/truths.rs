//! Truths that are constant, zero, near zero, alone, tied or not numbers.

use sps_metrics::{
    IntervalError, Intervals, Level, Metric, NonFiniteKind, Pair, Quantity, ScoreAccumulator,
    Scored, TrainingMean, Undefined,
};

use super::{naive, within};
use crate::support::{
    assert_close, every_metric, merged, not_finite, samples, training_mean, value,
};

#[test]
fn constant_truth_is_named_where_rounding_hides_it() {
    // Ten times 0.1 sums to less than one, so its mean is not 0.1 and nothing is zero.
    let (truth, estimate) = ([0.1; 10], [0.2; 10]);
    let scored = samples(&truth, &estimate);
    let constant = Err(Undefined::ConstantTruth { value: 0.1 });
    assert_eq!(scored.r2_own_mean(), constant);
    assert_eq!(scored.spearman(), constant);
    assert_eq!(scored.r2(training_mean(0.1)), constant);
    assert_eq!(TrainingMean::of(&truth).map(TrainingMean::get), Ok(0.1));

    let silent = naive::r2(&truth, &estimate, naive::mean(&truth));
    assert!(silent < -1e30 && silent.is_finite());
}

#[test]
fn constant_truth_away_from_the_training_mean_has_an_r2() {
    // Errors of 1 where the training mean is off by 4: 1 - 1/16.
    let (truth, estimate) = ([7.0; 5], [8.0; 5]);
    let scored = samples(&truth, &estimate);
    let found = value(&scored.r2(training_mean(3.0)));
    let own = naive::r2(&truth, &estimate, naive::mean(&truth));
    let case = "constant truth about the training mean";
    within(case, found, 0.9375, 0.0, own);
    let constant = Err(Undefined::ConstantTruth { value: 7.0 });
    assert_eq!(scored.r2_own_mean(), constant);
    // An epsilon in the denominator makes a number of it.
    let silent = 1.0 - naive::squared_error(&truth, &estimate) / (0.0 + 1e-10);
    assert!(silent.is_finite());
}

#[test]
fn zero_truths_are_left_out_and_counted() {
    let truth = [0.0, -0.0, 0.0, 10.0, 20.0];
    let estimate = [1.0, 1.0, 0.0, 11.0, 26.0];
    let score = samples(&truth, &estimate).median_percent_error();
    let score = score.expect("two truths other than zero");
    assert_eq!((score.samples, score.zero_truths), (2, 3));
    let silent = naive::median(naive::percent_errors(&truth, &estimate));
    // Of 10 % and 30 %.
    within("percentage of zero truths", score.value, 20.0, 0.0, silent);
}

#[test]
fn all_zero_truths_have_no_percentage() {
    let outcome = samples(&[0.0, -0.0], &[0.0, 1.0]).median_percent_error();
    assert_eq!(outcome, Err(Undefined::AllTruthsZero { samples: 2 }));
    let silent = naive::median(naive::percent_errors(&[0.0, -0.0], &[0.0, 1.0]));
    assert!(silent.is_finite());
}

#[test]
fn truths_near_zero_keep_their_percentage() {
    // Twice the truth is 100 % off, down to the smallest denormal.
    let truth = [1e-20, -1e-300, f64::MIN_POSITIVE, 5e-324];
    let estimate = truth.map(|truth| 2.0 * truth);
    let score = samples(&truth, &estimate).median_percent_error();
    let silent = naive::median(naive::percent_errors(&truth, &estimate));
    let case = "percentage of truths near zero";
    within(case, value(&score), 100.0, 0.0, silent);
}

#[test]
fn a_percentage_beyond_f64_is_out_of_range() {
    let outcome = samples(&[5e-324], &[1.0]).median_percent_error();
    assert_eq!(outcome, Err(Undefined::OutOfRange));
    // Two middles that add up to more than f64 holds: their mean is 1.2e308.
    let outcome = samples(&[1.0; 2], &[1.0e306, 1.4e306]).median_percent_error();
    assert_close(value(&outcome), 1.2e308, 1e-15);
    assert!(naive::median(vec![1.0e308, 1.4e308]).is_infinite());
}

#[test]
fn one_sample_has_errors_but_no_own_mean() {
    let one = samples(&[4.0], &[5.0]);
    let too_few = Err(Undefined::TooFewSamples {
        found: 1,
        needed: 2,
    });
    assert_eq!(one.r2_own_mean(), too_few);
    assert_eq!(one.spearman(), too_few);
    assert_eq!(value(&one.mae()), 1.0);
    assert_eq!(value(&one.rmse()), 1.0);
    assert_eq!(value(&one.median_percent_error()), 25.0);
    let silent = naive::r2(&[4.0], &[5.0], 4.0);
    let about = value(&one.r2(training_mean(2.0)));
    within("one sample", about, 0.75, 0.0, silent);
    let found = Intervals::of_models(Level::P95).interval(&[Scored::new(Metric::Mae, one)]);
    assert_eq!(found, Err(IntervalError::OneUnit));
}

#[test]
fn all_nan_is_named_by_every_score() {
    let nan = [f64::NAN; 9];
    let reason = Err(not_finite(Quantity::Truth, 0, NonFiniteKind::Nan, [9, 9]));
    let scored = samples(&nan, &nan);
    for metric in every_metric(1.0) {
        assert_eq!(metric.score(scored), reason, "{metric:?}");
    }
    assert!(naive::r2_of_sums(&nan, &nan).is_nan());
}

#[test]
fn one_nan_in_a_merged_stream_is_found_where_it_is() {
    let mut parts = vec![ScoreAccumulator::new(); 3];
    for i in 0..3000 {
        let truth = if i == 2345 { f64::NAN } else { f64::from(i) };
        let pair = Pair {
            truth,
            estimate: 1.0,
        };
        parts[i as usize / 1000].push(pair);
    }
    let sums = merged(&parts);
    let reason = not_finite(Quantity::Truth, 2345, NonFiniteKind::Nan, [1, 3000]);
    assert_eq!(sums.mae(), Err(reason));
    // Sorted by total order the NaN is last, and the median does not show it.
    let mut percent = vec![1.0, 2.0, 3.0, 4.0];
    percent.push(f64::NAN);
    assert_eq!(naive::median(percent), 3.0);
}

#[test]
fn signed_zeros_share_a_rank() {
    let (truth, estimate) = ([-0.0, 0.0, 1.0], [1.0, 2.0, 3.0]);
    let tied = samples(&truth, &estimate).spearman();
    let silent = naive::spearman(&truth, &estimate);
    let expected = 3f64.sqrt() / 2.0;
    within("signed zeros", value(&tied), expected, 1e-15, silent);
}

#[test]
fn ranks_of_many_ties_are_exact() {
    // Truth in blocks of equal values, estimate reversed: exactly -1, for any size.
    let truth: Vec<f64> = (0..200_000).map(|i| f64::from(i / 1000)).collect();
    let estimate: Vec<f64> = truth.iter().map(|t| -t).collect();
    let silent = naive::spearman(&truth, &estimate);
    let found = value(&samples(&truth, &estimate).spearman());
    within("many ties", found, -1.0, 0.0, silent);
}
