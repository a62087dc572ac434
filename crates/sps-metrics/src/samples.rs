mod percent;
pub(crate) mod ranks;

use crate::accumulate::ScoreAccumulator;
use crate::interval::{Scale, Terms, of_median, of_spearman};
use crate::moments::Moments;
use crate::outcome::{Outcome, Quantity, Undefined};
use percent::{median_percent_error, percent_error};

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
///
/// ```
/// use sps_metrics::{Intervals, Level, Metric, Samples, Scored, TrainingMean};
///
/// let samples = Samples {
///     truth: &[12.0, 35.0, 0.0, 61.0, 44.0, 27.0],
///     estimate: &[15.0, 33.0, 4.0, 58.0, 49.0, 27.0],
/// };
/// let mean = TrainingMean::of(&[20.0, 40.0, 36.0])?;
/// let r2 = samples.r2(mean)?.value;
/// assert_eq!(r2, 1.0 - 63.0 / 2443.0);
///
/// // A truth of zero has no percentage: it is left out and counted.
/// let percent = samples.median_percent_error()?;
/// assert_eq!((percent.samples, percent.zero_truths), (5, 1));
///
/// let scored = Scored::new(Metric::R2(mean), samples);
/// let interval = Intervals::of_models(Level::P95).interval(&[scored])?;
/// assert!(interval.low < r2 && r2 < interval.high);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
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
    /// [`Undefined::NonFinite`].
    pub fn new(mean: f64) -> Result<Self, Undefined> {
        Quantity::TrainingMean.finite(mean).map(Self)
    }

    /// The mean of the training truths.
    ///
    /// # Errors
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
    /// [`Undefined::ConstantTruth`] where every truth equals m.
    pub fn r2(self, mean: TrainingMean) -> Outcome {
        self.accumulate()?.r2(mean)
    }

    /// R² against the samples' own mean, as scikit-learn's `r2_score`.
    ///
    /// # Errors
    /// [`Undefined::ConstantTruth`]; [`Undefined::TooFewSamples`] for one sample.
    pub fn r2_own_mean(self) -> Outcome {
        self.accumulate()?.r2_own_mean()
    }

    /// Mean absolute error, in the unit of the truth.
    ///
    /// # Errors
    /// Those of every score.
    pub fn mae(self) -> Outcome {
        self.accumulate()?.mae()
    }

    /// Root of the mean squared error, in the unit of the truth.
    ///
    /// # Errors
    /// Those of every score.
    pub fn rmse(self) -> Outcome {
        self.accumulate()?.rmse()
    }

    /// Median of 100 |t - t̂| / |t|, in percent. Samples whose truth is exactly zero are left out
    /// and counted in [`Score::zero_truths`](crate::Score::zero_truths). Of an even number of
    /// samples it is the mean of the middle two.
    ///
    /// # Errors
    /// [`Undefined::AllTruthsZero`].
    pub fn median_percent_error(self) -> Outcome {
        median_percent_error(self.pairs()?)
    }

    /// Spearman's rank correlation, -1 to 1; equal values share their average rank.
    ///
    /// # Errors
    /// [`Undefined::ConstantTruth`], [`Undefined::ConstantEstimate`];
    /// [`Undefined::TooFewSamples`] for one sample.
    pub fn spearman(self) -> Outcome {
        self.accumulate()?.samples()?;
        ranks::spearman(self)
    }

    /// The samples one by one.
    pub(crate) fn pairs(self) -> Result<impl Iterator<Item = Pair> + 'a, Undefined> {
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

/// A score by name, for code that treats them alike (intervals, tables, reports).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Metric {
    /// [`Samples::r2`] about this mean of the training split.
    R2(TrainingMean),
    /// [`Samples::r2_own_mean`].
    R2OwnMean,
    /// [`Samples::mae`].
    Mae,
    /// [`Samples::rmse`].
    Rmse,
    /// [`Samples::median_percent_error`].
    MedianPercentError,
    /// [`Samples::spearman`].
    Spearman,
}

/// Which of two scores is the better one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Better {
    /// The larger one, as for R².
    Higher,
    /// The smaller one, as for errors.
    Lower,
}

impl Metric {
    /// Those that are about no mean.
    pub const ABOUT_NO_MEAN: [Self; 4] = [
        Self::Mae,
        Self::Rmse,
        Self::MedianPercentError,
        Self::Spearman,
    ];

    /// The metric's score of these samples.
    ///
    /// # Errors
    /// Those of the method of [`Samples`] that it names.
    pub fn score(self, samples: Samples<'_>) -> Outcome {
        match self {
            Self::R2(mean) => samples.r2(mean),
            Self::R2OwnMean => samples.r2_own_mean(),
            Self::Mae => samples.mae(),
            Self::Rmse => samples.rmse(),
            Self::MedianPercentError => samples.median_percent_error(),
            Self::Spearman => samples.spearman(),
        }
    }

    /// The sums that its score of these samples is made of, for intervals.
    pub(crate) fn terms(self, samples: Samples<'_>) -> Result<Terms, Undefined> {
        let pairs: Vec<Pair> = samples.pairs()?.collect();
        let errors = pairs.iter().map(|pair| (pair.truth - pair.estimate).abs());
        Ok(match self {
            Self::R2(mean) => Terms::r2(&pairs, Some(mean.get())),
            Self::R2OwnMean => Terms::r2(&pairs, None),
            Self::Mae => Terms::mean(errors.map(Some)),
            Self::Rmse => Terms::mean(errors.map(|error| Some(error.powi(2)))).root(),
            Self::MedianPercentError => {
                let percent: Vec<_> = pairs.iter().map(|&pair| percent_error(pair)).collect();
                Terms::mean(of_median(&percent))
            }
            Self::Spearman => Terms::mean(of_spearman(samples).into_iter().map(Some)),
        })
    }

    /// The name in files, for example `median_percent_error`.
    pub const fn id(self) -> &'static str {
        match self {
            Self::R2(_) => "r2",
            Self::R2OwnMean => "r2_own_mean",
            Self::Mae => "mae",
            Self::Rmse => "rmse",
            Self::MedianPercentError => "median_percent_error",
            Self::Spearman => "spearman",
        }
    }

    /// On which its interval reaches equally far to either side.
    pub(crate) const fn scale(self) -> Scale {
        match self {
            Self::R2(_) | Self::R2OwnMean => Scale::Unexplained,
            Self::Mae | Self::Rmse | Self::MedianPercentError => Scale::Logarithm,
            Self::Spearman => Scale::Fisher,
        }
    }
}

/// Every score of one property.
#[derive(Clone, Debug, PartialEq)]
pub struct Scores {
    /// [`Samples::r2`], the paper's.
    pub r2: Outcome,
    /// [`Samples::r2_own_mean`].
    pub r2_own_mean: Outcome,
    /// [`Samples::mae`].
    pub mae: Outcome,
    /// [`Samples::rmse`].
    pub rmse: Outcome,
    /// [`Samples::median_percent_error`].
    pub median_percent_error: Outcome,
    /// [`Samples::spearman`].
    pub spearman: Outcome,
}

impl Scores {
    /// Scores samples every way. Where the training mean has no value (the training split lacks the
    /// property), neither has [`Scores::r2`], and its reason says so.
    pub fn of(samples: Samples<'_>, mean: Result<TrainingMean, Undefined>) -> Self {
        let no_mean = |reason| Undefined::NoTrainingMean {
            reason: Box::new(reason),
        };
        let sums = &samples.accumulate();
        let scored = |score: &dyn Fn(&ScoreAccumulator) -> Outcome| {
            sums.as_ref().map_err(Undefined::clone).and_then(score)
        };
        Self {
            r2: mean
                .map_err(no_mean)
                .and_then(|mean| scored(&|sums| sums.r2(mean))),
            r2_own_mean: scored(&ScoreAccumulator::r2_own_mean),
            mae: scored(&ScoreAccumulator::mae),
            rmse: scored(&ScoreAccumulator::rmse),
            median_percent_error: samples.median_percent_error(),
            spearman: samples.spearman(),
        }
    }
}
