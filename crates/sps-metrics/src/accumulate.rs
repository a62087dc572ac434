use crate::double::Double;
use crate::moments::{LEAST_SUM_OF_SQUARES, ShiftedSums, trusted};
use crate::outcome::{Outcome, Quantity, Undefined, score};
use crate::samples::{Pair, TrainingMean};
use crate::screen::Screen;

/// R² about any reference, MAE and RMSE of a stream of samples, in constant memory.
///
/// Sums are kept in double-double arithmetic (see [`Moments`](crate::Moments)), so that every
/// score is the same within 1e-12 relative for any order of the samples and any split of them into
/// merged parts, also for values like 1e8 + small and for an R² near zero.
///
/// ```
/// use sps_metrics::{Pair, ScoreAccumulator, TrainingMean};
///
/// let mut first = ScoreAccumulator::new();
/// first.push(Pair { truth: 10.0, estimate: 12.0 });
/// let mut second = ScoreAccumulator::new();
/// second.push(Pair { truth: 30.0, estimate: 29.0 });
/// first.merge(&second);
///
/// let r2 = first.r2(TrainingMean::new(25.0)?)?;
/// assert_eq!(r2.value, 1.0 - 5.0 / 250.0);
/// assert_eq!(r2.samples, 2);
/// assert_eq!(first.mae()?.value, 1.5);
/// # Ok::<(), sps_metrics::Undefined>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct ScoreAccumulator {
    screen: Screen,
    truth: ShiftedSums,
    absolute_errors: Double,
    squared_errors: Double,
}

impl ScoreAccumulator {
    /// No samples yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a sample. One that is not finite makes every score an error that names it.
    pub fn push(&mut self, pair: Pair) {
        let Pair { truth, estimate } = pair;
        let parts = [(Quantity::Truth, truth), (Quantity::Estimate, estimate)];
        if self.screen.admit(parts) {
            let error = Double::difference(truth, estimate);
            self.truth.push(truth);
            self.absolute_errors += error.abs();
            self.squared_errors += error * error;
        }
    }

    /// Adds all samples of `later`, as if they had been pushed after those of `self`.
    pub fn merge(&mut self, later: &Self) {
        self.screen.merge(&later.screen);
        self.truth.merge(&later.truth);
        self.absolute_errors += later.absolute_errors;
        self.squared_errors += later.squared_errors;
    }

    /// As [`Samples::r2`](crate::Samples::r2); the reference is needed only here.
    ///
    /// # Errors
    /// As [`Samples::r2`](crate::Samples::r2).
    pub fn r2(&self, mean: TrainingMean) -> Outcome {
        let samples = self.samples()?;
        let mean = mean.get();
        match self.truth.constant() {
            Some(value) if value == mean => Err(Undefined::ConstantTruth { value }),
            _ => self.explained(self.truth.about(mean).1, samples),
        }
    }

    /// As [`Samples::r2_own_mean`](crate::Samples::r2_own_mean).
    ///
    /// # Errors
    /// As [`Samples::r2_own_mean`](crate::Samples::r2_own_mean).
    pub fn r2_own_mean(&self) -> Outcome {
        let samples = self.samples()?;
        match self.truth.constant() {
            _ if samples < 2 => Err(Undefined::TooFewSamples {
                found: samples,
                needed: 2,
            }),
            Some(value) => Err(Undefined::ConstantTruth { value }),
            None => self.explained(self.truth.about_mean(), samples),
        }
    }

    /// As [`Samples::mae`](crate::Samples::mae).
    ///
    /// # Errors
    /// As [`Samples::mae`](crate::Samples::mae).
    pub fn mae(&self) -> Outcome {
        let samples = self.samples()?;
        let mean = self.absolute_errors / Double::from(samples as f64);
        score(mean.value(), samples)
    }

    /// As [`Samples::rmse`](crate::Samples::rmse).
    ///
    /// # Errors
    /// As [`Samples::rmse`](crate::Samples::rmse).
    pub fn rmse(&self) -> Outcome {
        let samples = self.samples()?;
        let exact = self.absolute_errors == Double::default();
        if !exact && self.squared_errors.value() < LEAST_SUM_OF_SQUARES {
            return Err(Undefined::OutOfRange);
        }
        let mean = self.squared_errors / Double::from(samples as f64);
        score(mean.value().sqrt(), samples)
    }

    /// How many samples were pushed.
    ///
    /// # Errors
    /// [`Undefined::Empty`], and [`Undefined::NonFinite`] where one is not finite.
    pub fn samples(&self) -> Result<usize, Undefined> {
        self.screen.samples()
    }

    /// The share of `total` that is not error. The subtraction comes before the rounding to `f64`,
    /// so an R² near zero keeps all its digits.
    fn explained(&self, total: Double, samples: usize) -> Outcome {
        let total = trusted(total)?;
        score(((total - self.squared_errors) / total).value(), samples)
    }
}

impl FromIterator<Pair> for ScoreAccumulator {
    fn from_iter<I: IntoIterator<Item = Pair>>(pairs: I) -> Self {
        let mut accumulator = Self::new();
        pairs.into_iter().for_each(|pair| accumulator.push(pair));
        accumulator
    }
}
