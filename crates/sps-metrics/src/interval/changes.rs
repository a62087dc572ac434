//! By how much a score changes when a unit is left out, or weighs more, without scoring again.

use super::{IntervalError, Scored};
use crate::samples::Pair;

/// A remainder of a sum that is smaller than this share of it is what rounding left.
const ROUNDING: f64 = 1e-12;

/// What a unit is to a score.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Change {
    /// The score without it less the score.
    pub without: f64,
    /// Less the derivative of the score by the unit's weight. The same to first order; of a unit that is
    /// much of all there is, it says more of what a second such unit would do.
    pub lighter: f64,
}

/// The change of each unit, by its number, of samples that have a score.
pub(super) fn changes(scored: &Scored<'_>) -> Result<Vec<(usize, Change)>, IntervalError> {
    /// Of a weight, for a derivative by differences.
    const STEP: f64 = 1e-4;
    let samples = scored.samples.truth.len();
    if let Some(units) = scored.units
        && units.len() != samples
    {
        return Err(IntervalError::UnitMismatch {
            samples,
            units: units.len(),
        });
    }
    let unit = |at: usize| scored.units.map_or(at, |units| units[at]);
    let terms = scored.metric.terms(scored.samples)?;
    let total = sum(terms.each.iter().copied());
    let mut order: Vec<usize> = (0..samples).collect();
    order.sort_by_key(|&at| unit(at));
    let whole = (terms.score)(total);
    let of_unit = order.chunk_by(|&one, &next| unit(one) == unit(next));
    let changes = of_unit.map(|alike| {
        let sums = sum(alike.iter().map(|&at| terms.each[at]));
        let rest = total.without(sums).map(terms.score);
        let rest = rest.filter(|score| score.is_finite());
        let rest = rest.ok_or(IntervalError::OneUnit)?;
        let weighing = |more: f64| (terms.score)(total.plus(sums, more));
        let change = Change {
            without: rest - whole,
            lighter: (weighing(-STEP) - weighing(STEP)) / (2.0 * STEP),
        };
        Ok((unit(alike[0]), change))
    });
    changes.collect()
}

/// Sums over samples that a score is made of: how many there are, what it divides, and the sum and
/// the sum of squares of what it divides by.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: f64,
    errors: f64,
    deviations: f64,
    squares: f64,
}

fn sum(terms: impl Iterator<Item = Sums>) -> Sums {
    terms.fold(Sums::default(), |sums, term| sums.plus(term, 1.0))
}

impl Sums {
    /// With some so many times more.
    fn plus(self, some: Self, times: f64) -> Self {
        Self {
            count: self.count + times * some.count,
            errors: self.errors + times * some.errors,
            deviations: self.deviations + times * some.deviations,
            squares: self.squares + times * some.squares,
        }
    }

    /// What is left without some; `None` where that is nothing that can be told from rounding.
    fn without(self, some: Self) -> Option<Self> {
        let rest = self.plus(some, -1.0);
        let varies = self.squares == 0.0 || rest.squares > ROUNDING * self.squares;
        (rest.count > 0.0 && varies).then_some(rest)
    }

    /// The sum of squares about the mean.
    fn about_mean(self) -> f64 {
        let rest = self.squares - self.deviations * self.deviations / self.count;
        let varies = rest > ROUNDING * self.squares;
        if varies { rest } else { 0.0 }
    }
}

/// A score as a function of sums over samples.
pub(crate) struct Terms {
    each: Vec<Sums>,
    score: fn(Sums) -> f64,
}

impl Terms {
    /// Of a mean of numbers, or of influences, whose mean without a unit is how much the score changes
    /// without it; of samples without one nothing.
    pub(crate) fn mean(numbers: impl IntoIterator<Item = Option<f64>>) -> Self {
        let term = |number: Option<f64>| match number {
            Some(errors) => Sums {
                count: 1.0,
                errors,
                ..Sums::default()
            },
            None => Sums::default(),
        };
        Self {
            each: numbers.into_iter().map(term).collect(),
            score: mean_of,
        }
    }

    /// Of the root of a mean.
    pub(crate) fn root(self) -> Self {
        Self {
            score: |sums| mean_of(sums).max(0.0).sqrt(),
            ..self
        }
    }

    /// Of R² about a mean, or about the samples' own where there is none.
    pub(crate) fn r2(pairs: &[Pair], mean: Option<f64>) -> Self {
        let origin = mean.unwrap_or_else(|| middle(pairs));
        let term = |pair: &Pair| Sums {
            count: 1.0,
            errors: (pair.truth - pair.estimate).powi(2),
            deviations: pair.truth - origin,
            squares: (pair.truth - origin).powi(2),
        };
        Self {
            each: pairs.iter().map(term).collect(),
            score: match mean {
                Some(_) => |sums| 1.0 - sums.errors / sums.squares,
                None => |sums| 1.0 - sums.errors / sums.about_mean(),
            },
        }
    }
}

fn mean_of(sums: Sums) -> f64 {
    sums.errors / sums.count
}

/// The middle truth: near the bulk of them, so that differences from it are exact for that bulk.
fn middle(pairs: &[Pair]) -> f64 {
    let mut truth: Vec<f64> = pairs.iter().map(|pair| pair.truth).collect();
    let middle = truth.len() / 2;
    if truth.is_empty() {
        return 0.0;
    }
    *truth.select_nth_unstable_by(middle, f64::total_cmp).1
}
