use crate::accumulate::ScoreAccumulator;
use crate::moments::Moments;
use crate::outcome::{NonFiniteKind, Outcome, Quantity, Undefined};
use crate::percent::PercentErrorAccumulator;
use crate::ranks;

/// One sample: what was measured and what the model said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// The measured value.
    pub truth: f64,
    /// The model's value.
    pub estimate: f64,
}

/// The samples of one property, `(samples)` each, in the same order and unit.
///
/// Every score returns an [`Outcome`]: a [`Score`](crate::Score), or an [`Undefined`] that says why there is none. All
/// of them return [`Undefined::Empty`], [`Undefined::LengthMismatch`], [`Undefined::NonFinite`] and
/// [`Undefined::OutOfRange`] where these apply; each lists what else it returns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Samples<'a> {
    /// The measured values.
    pub truth: &'a [f64],
    /// The model's values.
    pub estimate: &'a [f64],
}

/// The mean of a property over the *training* split: the reference of the paper's R².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingMean(f64);

impl TrainingMean {
    /// A mean that is known already.
    ///
    /// # Errors
    ///
    /// [`Undefined::NonFinite`].
    pub fn new(mean: f64) -> Result<Self, Undefined> {
        match NonFiniteKind::of(mean) {
            None => Ok(Self(mean)),
            Some(kind) => Err(Undefined::NonFinite {
                quantity: Quantity::TrainingMean,
                index: 0,
                kind,
                count: 1,
                of: 1,
            }),
        }
    }

    /// The mean of the training truths.
    ///
    /// # Errors
    ///
    /// [`Undefined::Empty`], [`Undefined::NonFinite`], [`Undefined::OutOfRange`].
    pub fn of(training_truth: &[f64]) -> Result<Self, Undefined> {
        let moments: Moments = training_truth.iter().copied().collect();
        moments.mean().map(Self)
    }

    /// The mean, in the unit of the truth.
    pub const fn get(self) -> f64 {
        self.0
    }
}

impl<'a> Samples<'a> {
    /// R² as the paper writes it (section 5, "Evaluation Metric"): 1 - Σ(t - t̂)² / Σ(t - m)², with
    /// m the mean of the training split. 1 is perfect, 0 is as good as always saying m.
    ///
    /// One sample, or truths that are all one value other than m, do have an R² about m; it says
    /// how much closer than m the estimates are, and nothing about variation among the samples.
    ///
    /// # Errors
    ///
    /// [`Undefined::ConstantTruth`] where every truth equals m.
    pub fn r2(self, mean: TrainingMean) -> Outcome {
        self.accumulate()?.r2(mean)
    }

    /// R² against the samples' own mean, as scikit-learn's `r2_score`.
    ///
    /// # Errors
    ///
    /// [`Undefined::ConstantTruth`]; [`Undefined::TooFewSamples`] for one sample.
    pub fn r2_own_mean(self) -> Outcome {
        self.accumulate()?.r2_own_mean()
    }

    /// Mean absolute error, in the unit of the truth.
    ///
    /// # Errors
    ///
    /// Those of every score.
    pub fn mae(self) -> Outcome {
        self.accumulate()?.mae()
    }

    /// Root of the mean squared error, in the unit of the truth.
    ///
    /// # Errors
    ///
    /// Those of every score.
    pub fn rmse(self) -> Outcome {
        self.accumulate()?.rmse()
    }

    /// Median of 100 |t - t̂| / |t|, in percent. Samples whose truth is exactly zero are left out
    /// and counted in [`Score::zero_truths`](crate::Score::zero_truths). Of an even number of
    /// samples it is the mean of the middle two.
    ///
    /// # Errors
    ///
    /// [`Undefined::AllTruthsZero`].
    pub fn median_percent_error(self) -> Outcome {
        let mut accumulator: PercentErrorAccumulator = self.pairs()?.collect();
        accumulator.score()
    }

    /// Spearman's rank correlation, -1 to 1; equal values share their average rank.
    ///
    /// # Errors
    ///
    /// [`Undefined::ConstantTruth`], [`Undefined::ConstantEstimate`];
    /// [`Undefined::TooFewSamples`] for one sample.
    pub fn spearman(self) -> Outcome {
        self.accumulate()?.samples()?;
        ranks::spearman(self)
    }

    /// The samples one by one.
    ///
    /// # Errors
    ///
    /// [`Undefined::LengthMismatch`].
    pub fn pairs(self) -> Result<impl Iterator<Item = Pair> + 'a, Undefined> {
        if self.truth.len() == self.estimate.len() {
            let both = self.truth.iter().zip(self.estimate);
            Ok(both.map(|(&truth, &estimate)| Pair { truth, estimate }))
        } else {
            Err(Undefined::LengthMismatch {
                truths: self.truth.len(),
                estimates: self.estimate.len(),
            })
        }
    }

    pub(crate) fn accumulate(self) -> Result<ScoreAccumulator, Undefined> {
        Ok(self.pairs()?.collect())
    }
}
