//! Intervals of scores over units and reruns.

pub(crate) mod chance;
mod changes;
mod holm;
mod influence;

use thiserror::Error;

use crate::level::Level;
use crate::outcome::Undefined;
use crate::samples::{Metric, Samples};
use chance::Part;
pub use chance::Side;
pub(crate) use changes::Terms;
pub use holm::holm;
pub(crate) use influence::{of_median, of_spearman};

/// How far scores would move if other surfaces had been tested, and other models trained.
///
/// A score has two sources of chance. One is the *units* that were tested: a unit is what was drawn
/// independently, a surface, or where surfaces come in groups whose members are alike the group. The
/// other is the *reruns*: another training draws other initial weights, batches, training surfaces
/// or splits. Each source gives a variance of its own:
///
/// - of units, the larger of the delete-one jackknife and the infinitesimal one (Efron, "The
///   Jackknife, the Bootstrap and Other Resampling Plans", 1982, chapter 6), of which the second sees
///   what a unit that is much of all samples can do; ranks and medians by influence functions. Its
///   degrees of freedom are those of a variance of values with the kurtosis that the changes have,
///   at most one less than there are units, and few where few units decide;
/// - of reruns, the sample variance of their scores, with one degree of freedom less than there
///   are reruns. What units and reruns do together is in both variances and so counted twice. That
///   widens an interval by at most 41 %, the square root of 2, and where units differ much by little.
///
/// The half width is the root of the sum of the squares of the two half widths by Student's t (the
/// modified large-sample interval of Burdick and Graybill, "Confidence Intervals on Variance
/// Components", 1992). R² lies on the scale of ln(1 - R²), errors on that of their logarithm,
/// Spearman's correlation on Fisher's: an interval so ends where the score does, and is wider on the
/// side on which few units can do more. Nothing is drawn at random. `cargo run --release --example
/// coverage` says how often such intervals hold the truth.
///
/// ```
/// use sps_metrics::{Intervals, Level, Metric, Samples, Scored};
///
/// let truth = [12.0, 35.0, 8.0, 61.0, 44.0, 27.0, 19.0, 52.0];
/// let models = [
///     [15.0, 33.0, 10.0, 58.0, 49.0, 27.0, 22.0, 50.0],
///     [17.0, 36.0, 11.0, 57.0, 48.0, 25.0, 22.0, 51.0],
/// ];
/// let scored = [0, 1].map(|rerun| {
///     let samples = Samples { truth: &truth, estimate: &models[rerun] };
///     Scored { rerun, ..Scored::new(Metric::Mae, samples) }
/// });
///
/// // Of these two models, on other surfaces.
/// let fixed = Intervals::of_models(Level::P95).interval(&scored)?;
/// assert!(fixed.low < fixed.estimate && fixed.estimate < fixed.high);
///
/// // Of any model that is trained so: two reruns leave one degree of freedom.
/// let any = Intervals::of_training(Level::P95).interval(&scored)?;
/// assert!(any.high - any.low > fixed.high - fixed.low);
/// # Ok::<(), sps_metrics::IntervalError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intervals {
    level: Level,
    reruns_count: bool,
    test_per_training: f64,
}

/// One method's estimates of one property in one rerun, to be scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scored<'a> {
    /// The score.
    pub metric: Metric,
    /// The samples, `(samples)`.
    pub samples: Samples<'a>,
    /// The unit that each sample comes from, by any numbers, `(samples)`: its surface, or its group
    /// of surfaces where those of a group are alike. `None` where each sample is a unit of its own.
    /// Equal numbers are one unit, whatever the property, rerun or method.
    pub units: Option<&'a [usize]>,
    /// The rerun that the estimates are of, by any number.
    pub rerun: usize,
}

/// A score, or the difference of two, with its interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoreInterval {
    /// The score of the samples as they are, or the first method's less the second's.
    pub estimate: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
    /// The share of such intervals that hold the true value.
    pub level: Level,
    /// How many units it is over: surfaces, or groups of them.
    pub units: usize,
    /// How many reruns it is over.
    pub reruns: usize,
    /// The standard error that units and reruns make together.
    pub standard_error: f64,
    /// The two-sided p-value of a true value of 0. Of a difference: how often chance alone makes
    /// one as large.
    pub p: f64,
}

/// Why there is no interval.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum IntervalError {
    /// The score itself has no value.
    #[error("the score is undefined: {0}")]
    Undefined(#[from] Undefined),
    /// One training cannot say how much another would differ.
    #[error("reruns: {found}, and at least 2 are needed to see how much trainings differ")]
    TooFewReruns {
        /// How many there are.
        found: usize,
    },
    /// There is one unit, or without one of them there is no score: that cannot say how much
    /// another would differ.
    #[error("the score rests on one unit (surface or group), an interval needs at least 2")]
    OneUnit,
    /// Samples and unit numbers do not pair up.
    #[error("{units} unit numbers for {samples} samples")]
    UnitMismatch {
        /// How many samples there are.
        samples: usize,
        /// How many unit numbers there are.
        units: usize,
    },
}

impl<'a> Scored<'a> {
    /// Samples each of which is a unit of its own, in one rerun.
    pub fn new(metric: Metric, samples: Samples<'a>) -> Self {
        Self {
            metric,
            samples,
            units: None,
            rerun: 0,
        }
    }
}

impl ScoreInterval {
    /// Whether zero lies outside of the interval: for a single difference that was asked for
    /// beforehand, whether the methods differ. For one of many see [`holm`].
    pub fn excludes_zero(&self) -> bool {
        self.low > 0.0 || self.high < 0.0
    }
}

impl Intervals {
    /// For the models that were scored as they are: other units, but no other training.
    pub const fn of_models(level: Level) -> Self {
        Self {
            level,
            reruns_count: false,
            test_per_training: 0.0,
        }
    }

    /// For any model that is trained as the reruns were: other units and other trainings.
    pub const fn of_training(level: Level) -> Self {
        Self {
            reruns_count: true,
            ..Self::of_models(level)
        }
    }

    /// For reruns that part one set of surfaces anew, with so many units tested for each that is
    /// trained on (1/9 in ten folds). Their training parts share surfaces, so how much they differ
    /// says too little of how much training on other surfaces would. Nadeau and Bengio ("Inference
    /// for the generalization error", Machine Learning 52, 2003) count the units tested for each
    /// trained on once more for that: the variance of units grows by this share.
    #[must_use]
    pub const fn sharing(mut self, test_per_training: f64) -> Self {
        self.test_per_training = test_per_training;
        self
    }

    /// The interval of a score, or of the mean of several: of R² over properties and reruns, say.
    ///
    /// # Errors
    /// Any [`IntervalError`]; one score that has no value leaves the mean without one, so leave
    /// out beforehand what [`mean_over_all`](crate::mean_over_all) reports as left out.
    pub fn interval(&self, scored: &[Scored<'_>]) -> Result<ScoreInterval, IntervalError> {
        let side = Side::of(scored)?;
        let parts = self.parts(&[&side])?;
        let scale = scored.first().map(|scored| scored.metric.scale());
        Ok(self.found(side.mean, &parts, side.counts(), scale.unwrap_or_default()))
    }

    /// The interval of the difference between the means of two methods' scores, first less second.
    /// Units of the same number are the same for both, and so are reruns where both methods have
    /// the same: what is hard, or lucky, for both cancels out.
    ///
    /// # Errors
    /// As [`interval`](Self::interval).
    pub fn difference(
        &self,
        first: &[Scored<'_>],
        second: &[Scored<'_>],
    ) -> Result<ScoreInterval, IntervalError> {
        self.between(&Side::of(first)?, &Side::of(second)?)
    }

    /// As [`difference`](Self::difference), of a method that is compared with several, and so is scored once for all.
    ///
    /// # Errors
    /// As [`interval`](Self::interval).
    pub fn between(&self, first: &Side, second: &Side) -> Result<ScoreInterval, IntervalError> {
        let parts = self.parts(&[first, second])?;
        let counts = [first.counts(), second.counts()];
        let both = [0, 1].map(|at| counts[0][at].max(counts[1][at]));
        Ok(self.found(first.mean - second.mean, &parts, both, Scale::Plain))
    }

    /// The same of methods that were tested on units that have nothing to do with one another,
    /// whatever their numbers.
    ///
    /// # Errors
    /// As [`interval`](Self::interval).
    pub fn independent_difference(
        &self,
        first: &[Scored<'_>],
        second: &[Scored<'_>],
    ) -> Result<ScoreInterval, IntervalError> {
        let (first, second) = (Side::of(first)?, Side::of(second)?);
        let parts = [self.parts(&[&first])?, self.parts(&[&second])?].concat();
        let counts = [first.counts(), second.counts()];
        let both = [0, 1].map(|at| counts[0][at] + counts[1][at]);
        Ok(self.found(first.mean - second.mean, &parts, both, Scale::Plain))
    }

    /// The variances of one side, or of the difference of two.
    fn parts(&self, sides: &[&Side]) -> Result<Vec<Part>, IntervalError> {
        let mut parts = vec![chance::of_units(sides, 1.0 + self.test_per_training)?];
        if self.reruns_count {
            parts.extend(chance::of_reruns(sides)?);
        }
        Ok(parts)
    }

    fn found(
        &self,
        estimate: f64,
        parts: &[Part],
        [units, reruns]: [usize; 2],
        scale: Scale,
    ) -> ScoreInterval {
        let half = chance::half_width(parts, 1.0 - self.level.get());
        let [low, high] = scale.around(estimate, half);
        let variance: f64 = parts.iter().map(|part| part.variance).sum();
        ScoreInterval {
            estimate,
            low,
            high,
            level: self.level,
            units,
            reruns,
            standard_error: variance.sqrt(),
            p: chance::p_value(parts, estimate),
        }
    }
}

/// The scale on which a score's interval reaches equally far to either side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum Scale {
    #[default]
    Plain,
    /// ln x.
    Logarithm,
    /// ln(1 - x).
    Unexplained,
    /// The inverse hyperbolic tangent.
    Fisher,
}

impl Scale {
    /// The ends about `value` of an interval whose half width on the plain scale is `half`.
    fn around(self, value: f64, half: f64) -> [f64; 2] {
        let factor = |of: f64| (half / of).exp();
        match self {
            Self::Logarithm if value > 0.0 => [value / factor(value), value * factor(value)],
            Self::Unexplained if value < 1.0 => {
                let rest = 1.0 - value;
                [1.0 - rest * factor(rest), 1.0 - rest / factor(rest)]
            }
            Self::Fisher if value.abs() < 1.0 => {
                let (at, half) = (value.atanh(), half / (1.0 - value * value));
                [(at - half).tanh(), (at + half).tanh()]
            }
            // The end of a scale, where nothing varies.
            _ => [value - half, value + half],
        }
    }
}
