use thiserror::Error;

use crate::screen::Screen;

/// A score, or the reason why it has none.
pub type Outcome = Result<Score, Undefined>;

/// A finite score and what it rests on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// In the unit of its metric: none for R² and Spearman, the truth's for MAE and RMSE, percent
    /// for the median percentage error. Always finite.
    pub value: f64,
    /// How many samples the value rests on.
    pub samples: usize,
    /// How many samples were left out because their truth is zero, which makes a percentage
    /// undefined. Zero for every other metric.
    pub zero_truths: usize,
}

/// Why a score has no value.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Undefined {
    /// There is nothing to score.
    #[error("no samples")]
    Empty,
    /// The score compares samples with each other.
    #[error("{found} sample(s), needs at least {needed}")]
    TooFewSamples {
        /// How many there are.
        found: usize,
        /// How many the score needs.
        needed: usize,
    },
    /// The truths do not vary about the reference: all are one value (R² about their own mean,
    /// Spearman), or all equal the training mean (R² about the training mean).
    #[error("every truth is {value}, so there is no variation to explain")]
    ConstantTruth {
        /// What every truth is.
        value: f64,
    },
    /// The estimates are all one value, so they have no ranks (Spearman).
    #[error("every estimate is {value}, so there is no order to compare")]
    ConstantEstimate {
        /// What every estimate is.
        value: f64,
    },
    /// Every sample was left out of a percentage.
    #[error("all {samples} truths are zero, so no percentage is defined")]
    AllTruthsZero {
        /// How many samples there are.
        samples: usize,
    },
    /// An input is NaN or infinite.
    #[error("{quantity} {index} is {kind} ({count} of {of} samples are not finite)")]
    NonFinite {
        /// Which input.
        quantity: Quantity,
        /// The first sample with a value that is not finite, counted from 0.
        index: usize,
        /// What it is.
        kind: NonFiniteKind,
        /// How many samples have such a value.
        count: usize,
        /// How many samples there are.
        of: usize,
    },
    /// Truths and estimates, or truths and intervals, do not pair up.
    #[error("{truths} truths for {estimates} estimates")]
    LengthMismatch {
        /// How many truths there are.
        truths: usize,
        /// How many estimates or intervals there are.
        estimates: usize,
    },
    /// The inputs are finite, yet a sum or quotient of them leaves the range of an `f64`, or a sum
    /// of squares is too small to keep its digits. Differences between 1e-140 and 1e140 are safe.
    #[error("the values are too large or too small for this score in f64")]
    OutOfRange,
    /// R² has no reference.
    #[error("no training mean: {reason}")]
    NoTrainingMean {
        /// Why the training mean is undefined.
        reason: Box<Self>,
    },
    /// A mean asks for a property that was not scored.
    #[error("the property was not scored")]
    NotScored,
    /// A mean has nothing to average.
    #[error("none of the {of} values to average is defined")]
    NothingDefined {
        /// How many were asked for.
        of: usize,
    },
    /// A property would be counted twice.
    #[error("property `{property}` appears more than once")]
    RepeatedProperty {
        /// Its name.
        property: String,
    },
    /// The lower end of an interval lies above its upper end.
    #[error("interval {index} ends below its start")]
    InvertedInterval {
        /// Which interval, counted from 0.
        index: usize,
    },
}

/// What an input is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Quantity {
    /// A measured value.
    Truth,
    /// What a model said.
    Estimate,
    /// The mean of the training split.
    TrainingMean,
    /// Truth minus estimate.
    Residual,
    /// An end of an interval.
    IntervalEnd,
    /// A number of no stated meaning: a score among scores, a value among values.
    Value,
}

/// How a number fails to be finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NonFiniteKind {
    /// Not a number.
    Nan,
    /// Positive infinity.
    Infinity,
    /// Negative infinity.
    NegativeInfinity,
}

impl NonFiniteKind {
    /// `None` for a finite value.
    pub fn of(value: f64) -> Option<Self> {
        if value.is_finite() {
            None
        } else if value.is_nan() {
            Some(Self::Nan)
        } else if value > 0.0 {
            Some(Self::Infinity)
        } else {
            Some(Self::NegativeInfinity)
        }
    }
}

impl Quantity {
    /// The value, if it is finite: one of this kind, which stands alone.
    pub(crate) fn finite(self, value: f64) -> Result<f64, Undefined> {
        let mut screen = Screen::default();
        screen.admit([(self, value)]);
        screen.samples().map(|_| value)
    }
}

impl std::fmt::Display for Quantity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Truth => "truth",
            Self::Estimate => "estimate",
            Self::TrainingMean => "training mean",
            Self::Residual => "residual",
            Self::IntervalEnd => "interval",
            Self::Value => "value",
        })
    }
}

impl std::fmt::Display for NonFiniteKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Nan => "NaN",
            Self::Infinity => "infinite",
            Self::NegativeInfinity => "negative infinite",
        })
    }
}

/// The value if it is finite: sums that overflowed are caught here, once.
pub(crate) fn in_range(value: f64) -> Result<f64, Undefined> {
    let finite = value.is_finite().then_some(value);
    finite.ok_or(Undefined::OutOfRange)
}

/// A score that rests on all of so many samples.
pub(crate) fn score(value: f64, samples: usize) -> Outcome {
    Ok(Score {
        value: in_range(value)?,
        samples,
        zero_truths: 0,
    })
}
