//! By how much a score changes when a unit is left out, or weighs more, without scoring again.

use std::collections::BTreeMap;

use super::influence::{of_median, of_spearman};
use super::{IntervalError, Scored};
use crate::outcome::Undefined;
use crate::percent::percent_error;
use crate::samples::{Metric, Pair, Samples};

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
    let terms = Terms::of(scored.metric, scored.samples)?;
    let mut of_unit: BTreeMap<usize, Sums> = BTreeMap::new();
    let mut total = Sums::default();
    for (at, term) in terms.each.iter().enumerate() {
        of_unit.entry(unit(at)).or_default().add(term);
        total.add(term);
    }
    let whole = (terms.score)(total);
    let changes = of_unit.into_iter().map(|(unit, sums)| {
        let rest = total.without(sums).map(terms.score);
        let rest = rest.filter(|score| score.is_finite());
        let rest = rest.ok_or(IntervalError::OneUnit)?;
        let weighing = |more: f64| (terms.score)(total.plus(sums, more));
        let change = Change {
            without: rest - whole,
            lighter: (weighing(-STEP) - weighing(STEP)) / (2.0 * STEP),
        };
        Ok((unit, change))
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

impl Sums {
    fn add(&mut self, other: &Self) {
        *self = self.plus(*other, 1.0);
    }

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
        if rest > ROUNDING * self.squares {
            rest
        } else {
            0.0
        }
    }
}

/// A score as a function of sums over samples.
struct Terms {
    each: Vec<Sums>,
    score: fn(Sums) -> f64,
}

impl Terms {
    fn of(metric: Metric, samples: Samples<'_>) -> Result<Self, Undefined> {
        let pairs: Vec<Pair> = samples.pairs()?.collect();
        let errors = |power: i32| {
            let errors = pairs.iter();
            errors.map(move |pair| (pair.truth - pair.estimate).abs().powi(power))
        };
        let about = |origin: f64, errors: f64, pair: &Pair| Sums {
            count: 1.0,
            errors,
            deviations: pair.truth - origin,
            squares: (pair.truth - origin).powi(2),
        };
        let plain = |errors: f64| Sums {
            count: 1.0,
            errors,
            ..Sums::default()
        };
        let both = |origin: f64| {
            let both = errors(2).zip(&pairs);
            both.map(|(error, pair)| about(origin, error, pair))
                .collect()
        };
        let (each, score): (Vec<Sums>, fn(Sums) -> f64) = match metric {
            Metric::R2(mean) => (both(mean.get()), |sums| 1.0 - sums.errors / sums.squares),
            Metric::R2OwnMean => (both(middle(samples.truth)), |sums| {
                1.0 - sums.errors / sums.about_mean()
            }),
            Metric::Mae => (errors(1).map(plain).collect(), mean_of),
            Metric::Rmse => (errors(2).map(plain).collect(), |sums| {
                mean_of(sums).max(0.0).sqrt()
            }),
            Metric::MedianPercentError => {
                let errors: Vec<Option<f64>> =
                    pairs.iter().map(|&pair| percent_error(pair)).collect();
                (of_influences(&of_median(&errors)), mean_of)
            }
            Metric::Spearman => {
                let influences = of_spearman(samples).into_iter().map(Some);
                (of_influences(&influences.collect::<Vec<_>>()), mean_of)
            }
        };
        Ok(Self { each, score })
    }
}

fn mean_of(sums: Sums) -> f64 {
    sums.errors / sums.count
}

/// Terms whose mean without a unit is how much the score changes without it; of samples without an
/// influence nothing.
fn of_influences(influences: &[Option<f64>]) -> Vec<Sums> {
    let term = |influence: &Option<f64>| match influence {
        Some(errors) => Sums {
            count: 1.0,
            errors: *errors,
            ..Sums::default()
        },
        None => Sums::default(),
    };
    influences.iter().map(term).collect()
}

/// The middle truth: near the bulk of them, so that differences from it are exact for that bulk.
fn middle(truth: &[f64]) -> f64 {
    let mut truth = truth.to_vec();
    let middle = truth.len() / 2;
    if truth.is_empty() {
        return 0.0;
    }
    *truth.select_nth_unstable_by(middle, f64::total_cmp).1
}
