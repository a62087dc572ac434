//! Reference arithmetic that shares nothing with the crate.

use sps_metrics::{
    Level, Metric, NonFiniteKind, Outcome, Pair, Quantity, Samples, ScoreAccumulator, TrainingMean,
    Undefined,
};

#[path = "../../../../fixtures/golden/rule.rs"]
#[allow(dead_code, reason = "how far results are off is told otherwise here")]
pub(crate) mod rule;

pub(crate) use rule::numbers as uniform;

/// A sample in units of 2^-26, the last place of an `f64` near 1e8. In these units sums of squares
/// are exact integers, of more than 53 bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Units {
    pub(crate) truth: i64,
    pub(crate) estimate: i64,
}

pub(crate) const UNIT: f64 = 1.0 / 67_108_864.0;
/// 1e8.
pub(crate) const AT_1E8: i64 = 100_000_000 << 26;

impl Units {
    /// Exact: both have fewer than 53 bits.
    pub(crate) fn pair(self) -> Pair {
        Pair {
            truth: self.truth as f64 * UNIT,
            estimate: self.estimate as f64 * UNIT,
        }
    }
}

/// Sums of samples as integers about the first truth (so that they fit), and the scores that
/// follow, rounded once or twice at the end.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Exact {
    origin: i128,
    count: i128,
    sum: i128,
    squares: i128,
    absolute: i128,
    squared: i128,
}

impl FromIterator<Units> for Exact {
    fn from_iter<I: IntoIterator<Item = Units>>(samples: I) -> Self {
        let mut exact = Self::default();
        for Units { truth, estimate } in samples {
            let (truth, estimate) = (i128::from(truth), i128::from(estimate));
            if exact.count == 0 {
                exact.origin = truth;
            }
            exact.count += 1;
            exact.sum += truth - exact.origin;
            exact.squares += (truth - exact.origin).pow(2);
            exact.absolute += (truth - estimate).abs();
            exact.squared += (truth - estimate).pow(2);
        }
        exact
    }
}

impl Exact {
    /// The count times the sum of squares about the mean. The difference fits in 128 bits where its
    /// terms need not: what they lose beyond is the same on both sides.
    fn spread(self) -> i128 {
        let squares = self.count.wrapping_mul(self.squares);
        squares.wrapping_sub(self.sum.wrapping_mul(self.sum))
    }

    pub(crate) fn r2_own_mean(self) -> f64 {
        let total = self.spread();
        (total - self.count * self.squared) as f64 / total as f64
    }

    pub(crate) fn r2(self, mean_units: i64) -> f64 {
        let mean = i128::from(mean_units) - self.origin;
        let total = self.squares - 2 * mean * self.sum + self.count * mean * mean;
        (total - self.squared) as f64 / total as f64
    }

    pub(crate) fn mae(self) -> f64 {
        self.absolute as f64 / self.count as f64 * UNIT
    }

    pub(crate) fn rmse(self) -> f64 {
        (self.squared as f64 / self.count as f64).sqrt() * UNIT
    }

    pub(crate) fn variance(self) -> f64 {
        let total = self.spread();
        total as f64 / (self.count * (self.count - 1)) as f64 * UNIT * UNIT
    }
}

pub(crate) fn samples<'a>(truth: &'a [f64], estimate: &'a [f64]) -> Samples<'a> {
    Samples { truth, estimate }
}

/// Why samples are not scored of which so many of so many are not finite, the first of them at `index`.
pub(crate) fn not_finite(
    quantity: Quantity,
    index: usize,
    kind: NonFiniteKind,
    [count, of]: [usize; 2],
) -> Undefined {
    Undefined::NonFinite {
        quantity,
        index,
        kind,
        count,
        of,
    }
}

pub(crate) fn training_mean(mean: f64) -> TrainingMean {
    TrainingMean::new(mean).expect("a finite mean")
}

pub(crate) fn level(thousandths: usize) -> Level {
    Level::new(thousandths as f64 / 1000.0).expect("between 0 and 1")
}

pub(crate) fn value(outcome: &Outcome) -> f64 {
    outcome.as_ref().expect("a defined score").value
}

pub(crate) fn relative_error(found: f64, expected: f64) -> f64 {
    if found == expected {
        0.0
    } else {
        (found - expected).abs() / expected.abs()
    }
}

#[track_caller]
pub(crate) fn assert_close(found: f64, expected: f64, bound: f64) {
    let error = relative_error(found, expected);
    assert!(
        error <= bound,
        "{found:e} against {expected:e}: relative error {error:e}, allowed {bound:e}"
    );
}

/// As if the samples of all parts had come in their order.
pub(crate) fn merged<'a>(
    parts: impl IntoIterator<Item = &'a ScoreAccumulator>,
) -> ScoreAccumulator {
    let mut whole = ScoreAccumulator::new();
    for part in parts {
        whole.merge(part);
    }
    whole
}

pub(crate) fn every_metric(mean: f64) -> [Metric; 6] {
    [
        Metric::R2(training_mean(mean)),
        Metric::R2OwnMean,
        Metric::Mae,
        Metric::Rmse,
        Metric::MedianPercentError,
        Metric::Spearman,
    ]
}
