use crate::outcome::{Outcome, Quantity, Score, Undefined, in_range};
use crate::samples::Pair;
use crate::screen::Screen;

/// The median percentage error of a stream of samples.
///
/// A median that is exact for any order and any split has to hold one number per sample (8 bytes).
///
/// ```
/// use sps_metrics::{Pair, PercentErrorAccumulator};
///
/// let mut errors = PercentErrorAccumulator::new();
/// for (truth, estimate) in [(10.0, 12.0), (50.0, 45.0), (0.0, 3.0)] {
///     errors.push(Pair { truth, estimate });
/// }
/// let score = errors.score()?;
/// assert_eq!(score.value, 15.0); // of 20 % and 10 %
/// assert_eq!((score.samples, score.zero_truths), (2, 1));
/// # Ok::<(), sps_metrics::Undefined>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct PercentErrorAccumulator {
    screen: Screen,
    percent_errors: Vec<f64>,
}

impl PercentErrorAccumulator {
    /// No samples yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a sample. One that is not finite makes the score an error that names it; one whose
    /// truth is zero is counted and left out.
    pub fn push(&mut self, pair: Pair) {
        let Pair { truth, estimate } = pair;
        let parts = [(Quantity::Truth, truth), (Quantity::Estimate, estimate)];
        if self.screen.admit(parts) {
            self.percent_errors.extend(percent_error(pair));
        }
    }

    /// Adds all samples of `later`, as if they had been pushed after those of `self`.
    pub fn merge(&mut self, mut later: Self) {
        self.screen.merge(&later.screen);
        self.percent_errors.append(&mut later.percent_errors);
    }

    /// As [`Samples::median_percent_error`](crate::Samples::median_percent_error). Selection
    /// reorders the held values in place, which no later result can tell.
    ///
    /// # Errors
    ///
    /// As [`Samples::median_percent_error`](crate::Samples::median_percent_error).
    pub fn score(&mut self) -> Outcome {
        let seen = self.screen.samples()?;
        let samples = self.percent_errors.len();
        let median =
            median(&mut self.percent_errors).ok_or(Undefined::AllTruthsZero { samples: seen })?;
        Ok(Score {
            value: in_range(median)?,
            samples,
            zero_truths: seen - samples,
        })
    }
}

impl Extend<Pair> for PercentErrorAccumulator {
    fn extend<I: IntoIterator<Item = Pair>>(&mut self, pairs: I) {
        pairs.into_iter().for_each(|pair| self.push(pair));
    }
}

impl FromIterator<Pair> for PercentErrorAccumulator {
    fn from_iter<I: IntoIterator<Item = Pair>>(pairs: I) -> Self {
        let mut accumulator = Self::new();
        accumulator.extend(pairs);
        accumulator
    }
}

/// 100 |t - t̂| / |t|, which a truth of zero has not. Infinite where it overflows.
pub(crate) fn percent_error(pair: Pair) -> Option<f64> {
    let Pair { truth, estimate } = pair;
    (truth != 0.0).then(|| 100.0 * ((truth - estimate).abs() / truth.abs()))
}

/// The middle of non-negative values, by selection.
fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    let even = values.len().is_multiple_of(2);
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    let lower = below.iter().copied().max_by(f64::total_cmp);
    Some(match lower {
        Some(lower) if even => f64::midpoint(lower, upper),
        _ => upper,
    })
}
