//! How much better a method is than others, paired by surface.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use sps_metrics::{IntervalError, Scored, Side, Undefined, over_reruns};

use super::judged::{Judged, Reference};
use super::notes::Notes;
use super::{Kind, MethodOutcomes, Scoring};

/// Gains in `r2_mean`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Gains {
    /// Gain in `r2_mean` over the first method, with its paired interval.
    pub r2_mean_gain: Option<Gain>,
    /// The same over each method that the config compares with, by id.
    pub r2_mean_gains: BTreeMap<String, Gain>,
}

/// The difference of two methods' scores.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Gain {
    /// Above 0 where the method is ahead.
    pub value: f64,
    /// Over units and reruns; `null` where there is none, of one rerun say.
    pub interval: Option<[f64; 2]>,
    /// The p-value of no difference, not corrected for how many were compared; `null` with no
    /// interval, and in files whose intervals are over units alone.
    pub p: Option<f64>,
}

impl Gains {
    /// Over the first of `methods`, and over those at `against`.
    pub(super) fn of(
        method: &MethodOutcomes<'_>,
        methods: &[MethodOutcomes<'_>],
        against: &[usize],
        scoring: &Scoring<'_>,
        notes: &mut Notes,
    ) -> Self {
        let mut over = |at: usize| {
            let other = methods.get(at)?;
            let gain = gain(method, other, scoring, notes)?;
            Some((other.row.id.clone(), gain))
        };
        let gains: BTreeMap<String, Gain> = against.iter().filter_map(|&at| over(at)).collect();
        let first = methods.first().and_then(|first| gains.get(&first.row.id));
        Self {
            r2_mean_gain: match first {
                Some(gain) => Some(*gain),
                // One that has failed has its note already.
                None if against.contains(&0) => None,
                None => over(0).map(|(_, gain)| gain),
            },
            r2_mean_gains: gains,
        }
    }
}

/// The gain over `other` on the surfaces that both were scored on.
fn gain(
    method: &MethodOutcomes<'_>,
    other: &MethodOutcomes<'_>,
    scoring: &Scoring<'_>,
    notes: &mut Notes,
) -> Option<Gain> {
    if method.row.id == other.row.id {
        return None;
    }
    let mut pairs = Vec::new();
    for (property, mine) in &method.outcomes {
        let theirs = other.outcomes.get(property).into_iter().flatten();
        for (mine, theirs) in mine.iter().zip(theirs) {
            let sides = mine.common(theirs);
            if sides.iter().all(|side| side.has_r2()) {
                pairs.push(sides);
            }
        }
    }
    let what = format!("the interval of the gain over {}", other.row.label);
    let difference = side(method, &pairs, 0)
        .and_then(|mine| scoring.intervals.between(&mine, &side(other, &pairs, 1)?));
    let found = notes.found(&what, difference);
    Some(Gain {
        value: mean_difference(&pairs)?,
        interval: found.map(|found| [found.low, found.high]),
        p: found.map(|found| found.p),
    })
}

/// Two methods' estimates in one rerun, on the surfaces that both have; both have an R².
type Pair<'m, 'a> = [Cow<'m, Judged<'a>>; 2];

fn mean_difference(pairs: &[Pair<'_, '_>]) -> Option<f64> {
    let scores = |at: usize| {
        let scores = pairs.iter().map(|pair| pair[at].score(Kind::R2));
        let scores = scores.map(|score| score.map(|score| score.value));
        over_reruns(scores).mean.ok()
    };
    Some(scores(0)? - scores(1)?)
}

/// One side of the pairs: that of all trials of its method where none is left out or has lost surfaces.
fn side(
    method: &MethodOutcomes<'_>,
    pairs: &[Pair<'_, '_>],
    at: usize,
) -> Result<Side, IntervalError> {
    let of = |trials: &[&Judged<'_>]| {
        let scored = trials
            .iter()
            .map(|judged| judged.scored(Reference::Training));
        Side::of(&scored.collect::<Result<Vec<Scored<'_>>, Undefined>>()?)
    };
    let all: Vec<&Judged<'_>> = method.trials().filter(|judged| judged.has_r2()).collect();
    let whole = |pair: &Pair<'_, '_>| matches!(pair[at], Cow::Borrowed(_));
    if pairs.len() == all.len() && pairs.iter().all(whole) {
        return method.r2.get_or_init(|| of(&all)).clone();
    }
    of(&pairs.iter().map(|pair| &*pair[at]).collect::<Vec<_>>())
}
