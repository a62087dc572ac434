//! What has no score says why.

use sps_metrics::{
    InvalidLevel, Level, NonFiniteKind, Quantity, Samples, Scores, TrainingMean, Undefined,
};

use crate::support::{every_metric, not_finite, samples};

fn assert_refused(samples: Samples<'_>, reason: Undefined) {
    let reason = Err(reason);
    for metric in every_metric(1.0) {
        assert_eq!(metric.score(samples), reason, "{metric:?}");
    }
}

#[test]
fn empty_and_unequal_sets_are_refused_by_every_metric() {
    assert_refused(samples(&[], &[]), Undefined::Empty);
    let reason = Undefined::LengthMismatch {
        truths: 2,
        estimates: 1,
    };
    assert_refused(samples(&[1.0, 2.0], &[1.0]), reason);
}

#[test]
fn an_infinite_estimate_is_named_by_every_metric() {
    // The truth of the first is zero, which leaves it out of the percentage, not out of the check.
    let estimate = [1.0, f64::NEG_INFINITY, 3.0, f64::NAN];
    let kind = NonFiniteKind::NegativeInfinity;
    let reason = not_finite(Quantity::Estimate, 1, kind, [2, 4]);
    assert_refused(samples(&[0.0, 2.0, 3.0, 4.0], &estimate), reason);
}

#[test]
fn a_constant_estimate_has_no_rank_correlation() {
    let samples = samples(&[1.0, 2.0, 3.0], &[7.0; 3]);
    let constant = Undefined::ConstantEstimate { value: 7.0 };
    assert_eq!(samples.spearman(), Err(constant));
    assert!(samples.r2_own_mean().is_ok());
}

#[test]
fn a_training_mean_is_finite_or_says_why_not() {
    let error = TrainingMean::new(f64::INFINITY).expect_err("it is infinite");
    let expected = "training mean 0 is infinite (1 of 1 samples are not finite)";
    assert_eq!(error.to_string(), expected);
    assert_eq!(TrainingMean::of(&[]), Err(Undefined::Empty));
    let samples = samples(&[1.0, 2.0], &[1.0, 2.5]);
    let scores = Scores::of(samples, TrainingMean::of(&[]));
    let reason = scores.r2.expect_err("there is no training mean");
    assert_eq!(reason.to_string(), "no training mean: no samples");
    assert!(scores.r2_own_mean.is_ok());
}

#[test]
fn reasons_read_as_sentences() {
    let reasons = [
        (Undefined::Empty, "no samples"),
        (
            Undefined::ConstantTruth { value: 0.5 },
            "every truth is 0.5, so there is no variation to explain",
        ),
        (
            Undefined::AllTruthsZero { samples: 3 },
            "all 3 truths are zero, so no percentage is defined",
        ),
        (
            not_finite(Quantity::Truth, 4, NonFiniteKind::Nan, [2, 9]),
            "truth 4 is NaN (2 of 9 samples are not finite)",
        ),
    ];
    for (reason, text) in reasons {
        assert_eq!(reason.to_string(), text);
    }
}

#[test]
fn a_level_lies_between_zero_and_one() {
    for level in [0.0, 1.0, -0.5, 90.0, f64::NAN] {
        assert!(matches!(Level::new(level), Err(InvalidLevel { .. })));
    }
    assert_eq!(Level::new(0.9), Ok(Level::P90));
}
