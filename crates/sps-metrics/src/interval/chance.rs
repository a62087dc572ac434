//! How much of a score is chance: a variance by units and one by reruns, and Student's t of both.

use std::collections::BTreeMap;

use statrs::distribution::{ContinuousCDF, StudentsT};

use super::changes::{Change, changes};
use super::{IntervalError, Scored};
use crate::outcome::Undefined;

/// A variance, and what it rests on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Part {
    pub variance: f64,
    pub degrees_of_freedom: f64,
}

/// The mean of one method's scores, and how it changes with units and reruns: one side of any number of differences.
#[derive(Clone, Debug)]
pub struct Side {
    pub(super) mean: f64,
    /// What each unit is to the mean, by its number.
    units: BTreeMap<usize, Change>,
    /// The scores of each rerun, by its number.
    reruns: BTreeMap<usize, Vec<f64>>,
    scores: usize,
}

impl Side {
    /// Of these scores.
    ///
    /// # Errors
    /// As [`Intervals::interval`](super::Intervals::interval).
    pub fn of(scored: &[Scored<'_>]) -> Result<Self, IntervalError> {
        if scored.is_empty() {
            return Err(Undefined::Empty.into());
        }
        let scores = scored.len();
        let mut side = Self {
            mean: 0.0,
            units: BTreeMap::new(),
            reruns: BTreeMap::new(),
            scores,
        };
        for one in scored {
            let score = one.metric.score(one.samples)?.value;
            side.mean += score / scores as f64;
            side.reruns.entry(one.rerun).or_default().push(score);
            for (unit, change) in changes(one)? {
                let sum = side.units.entry(unit).or_default();
                sum.without += change.without / scores as f64;
                sum.lighter += change.lighter / scores as f64;
            }
        }
        Ok(side)
    }

    /// Units and reruns.
    pub(super) fn counts(&self) -> [usize; 2] {
        [self.units.len(), self.reruns.len()]
    }

    /// How far each rerun draws the mean.
    fn pulls(&self) -> impl Iterator<Item = f64> {
        let pull = |scores: &Vec<f64>| scores.iter().map(|score| score - self.mean).sum::<f64>();
        self.reruns
            .values()
            .map(move |scores| pull(scores) / self.scores as f64)
    }
}

/// The variance that units make of a side's mean, or of the first's less the second's; `times` it is
/// counted. The larger of that by leaving units out and that by their weights.
pub(super) fn of_units(sides: &[&Side], times: f64) -> Result<Part, IntervalError> {
    let mut units: BTreeMap<usize, Change> = BTreeMap::new();
    for (side, sign) in sides.iter().zip([1.0, -1.0]) {
        for (&unit, change) in &side.units {
            let sum = units.entry(unit).or_default();
            sum.without += sign * change.without;
            sum.lighter += sign * change.lighter;
        }
    }
    if units.len() < 2 {
        return Err(IntervalError::OneUnit);
    }
    let count = units.len() as f64;
    // Both are the variance of a mean where the score is one: changes without one of n values are
    // n / (n - 1) as large as by its weight.
    let scale = (count - 1.0) / count;
    let by = |of: fn(&Change) -> f64| spread(&units.values().map(of).collect::<Vec<f64>>());
    let (mut larger, lighter) = (by(|change| change.without), by(|change| change.lighter));
    larger.variance *= scale * scale;
    if lighter.variance > larger.variance {
        larger = lighter;
    }
    larger.variance *= times;
    Ok(larger)
}

/// The variance of a sum of independent values, from what each has added to it.
fn spread(values: &[f64]) -> Part {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let power = |n: i32| -> f64 { values.iter().map(|value| (value - mean).powi(n)).sum() };
    let (squares, fourths) = (power(2), power(4));
    let heavy = if squares > 0.0 {
        (count * fourths / (squares * squares) - 3.0).max(0.0)
    } else {
        0.0
    };
    // The variance of a variance is 2 / (n - 1) + kurtosis / n of its square; of normal values with
    // f degrees of freedom it is 2 / f.
    let degrees_of_freedom = 2.0 / (2.0 / (count - 1.0) + heavy / count);
    Part {
        variance: squares * count / (count - 1.0),
        degrees_of_freedom: degrees_of_freedom.max(1.0),
    }
}

/// The variances that reruns make of a side's mean, or of the first's less the second's: one where
/// both have the same reruns.
pub(super) fn of_reruns(sides: &[&Side]) -> Result<Vec<Part>, IntervalError> {
    match sides {
        [first, second] if first.reruns.keys().eq(second.reruns.keys()) => {
            let pulls = first.pulls().zip(second.pulls());
            Ok(vec![of_pulls(pulls.map(|(first, second)| first - second))?])
        }
        sides => sides.iter().map(|side| of_pulls(side.pulls())).collect(),
    }
}

fn of_pulls(pulls: impl Iterator<Item = f64>) -> Result<Part, IntervalError> {
    let pulls: Vec<f64> = pulls.collect();
    let found = pulls.len();
    if found < 2 {
        return Err(IntervalError::TooFewReruns { found });
    }
    let reruns = found as f64;
    let squares: f64 = pulls.iter().map(|pull| pull * pull).sum();
    Ok(Part {
        variance: squares * reruns / (reruns - 1.0),
        degrees_of_freedom: reruns - 1.0,
    })
}

/// Half the width of the interval that leaves out `tails` on both sides together.
pub(super) fn half_width(parts: &[Part], tails: f64) -> f64 {
    let squares = parts.iter().filter(|part| part.variance > 0.0).map(|part| {
        let t = student(part.degrees_of_freedom, tails / 2.0);
        t * t * part.variance
    });
    squares.sum::<f64>().sqrt()
}

/// The share on both sides together whose interval about `value` ends at 0.
pub(crate) fn p_value(parts: &[Part], value: f64) -> f64 {
    /// ln of the least that is told from 0.
    const LEAST: f64 = -60.0;
    let reaches = |logarithm: f64| half_width(parts, logarithm.exp()) >= value.abs();
    if value == 0.0 {
        return 1.0;
    }
    if !reaches(LEAST) {
        return 0.0;
    }
    let (mut low, mut high) = (LEAST, 0.0);
    for _ in 0..50 {
        let middle = f64::midpoint(low, high);
        if reaches(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low.exp()
}

/// The value that Student's t exceeds with the probability `tail`.
fn student(degrees_of_freedom: f64, tail: f64) -> f64 {
    let t = StudentsT::new(0.0, 1.0, degrees_of_freedom);
    // Not given for what is no distribution, which no number of units or reruns makes.
    t.map_or(f64::INFINITY, |t| -t.inverse_cdf(tail))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `scipy.stats.t.isf(tail, degrees_of_freedom)`, SciPy 1.17.
    #[test]
    fn quantiles_are_those_of_scipy() {
        for (degrees_of_freedom, tail, expected) in SCIPY {
            let found = student(degrees_of_freedom, tail);
            let off = (found / expected - 1.0).abs();
            assert!(
                off < 1e-9,
                "t of {degrees_of_freedom}, {tail}: {found}, expected {expected}"
            );
        }
    }

    const SCIPY: [(f64, f64, f64); 9] = [
        (1.0, 0.025, 12.706_204_736_174_7),
        (2.0, 0.025, 4.302_652_729_749_46),
        (2.0, 5e-05, 99.992_499_843_744_5),
        (4.5, 0.025, 2.658_912_347_204_4),
        (9.0, 0.025, 2.262_157_162_798_21),
        (9.0, 1e-06, 10.720_160_409_909_5),
        (19.0, 0.025, 2.093_024_054_408_31),
        (199.7, 0.025, 1.971_914_256_008_92),
        (1999.0, 0.0005, 3.295_400_576_927_38),
    ];

    /// One variance: the p-value is that of Student's t.
    #[test]
    fn a_p_value_ends_its_interval_at_0() {
        let parts = [(0.5, 7.0), (0.2, 2.0)].map(|(variance, degrees_of_freedom)| Part {
            variance,
            degrees_of_freedom,
        });
        for parts in [&parts[..1], &parts[..]] {
            for value in [0.01, 1.0, -3.0, 40.0] {
                let p = p_value(parts, value);
                let half = half_width(parts, p);
                assert!(
                    (half / value.abs() - 1.0).abs() < 1e-9,
                    "{value}: {p}, {half}"
                );
            }
        }
        let alone = p_value(&parts[..1], 0.5_f64.sqrt() * student(7.0, 0.025));
        assert!((alone - 0.05).abs() < 1e-9, "{alone}");
        assert_eq!([p_value(&parts, 0.0), p_value(&[], 0.1)], [1.0, 0.0]);
    }
}
