use crate::accumulate::ScoreAccumulator;
use crate::interval::Scale;
use crate::outcome::{Outcome, Undefined};
use crate::samples::{Samples, TrainingMean};

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
    /// The metric's score of these samples.
    ///
    /// # Errors
    ///
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

    /// Which of two scores of this metric is the better one.
    pub const fn better(self) -> Better {
        match self {
            Self::R2(_) | Self::R2OwnMean | Self::Spearman => Better::Higher,
            Self::Mae | Self::Rmse | Self::MedianPercentError => Better::Lower,
        }
    }
}

/// Every score of one property.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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
