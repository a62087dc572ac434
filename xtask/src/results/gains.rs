//! How much better a method is than others, paired by surface.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use sps_metrics::{BootstrapError, Compared, Undefined};

use super::notes::Notes;
use super::{Judged, MethodOutcomes, Scoring};

/// Gains in `r2_mean`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Gains {
    /// Gain in `r2_mean` over the first method, with its paired bootstrap interval.
    pub r2_mean_gain: Option<Gain>,
    /// The same over each method that the config compares with, by id.
    #[serde(default)]
    pub r2_mean_gains: BTreeMap<String, Gain>,
}

/// The difference of two methods' scores.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Gain {
    pub value: f64,
    pub interval: [f64; 2],
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
    let pairs: Vec<(Judged<'_>, Judged<'_>)> = method
        .outcomes
        .iter()
        .filter_map(|(property, mine)| Some((mine, other.outcomes.get(property)?)))
        .flat_map(|(mine, theirs)| mine.iter().zip(theirs))
        .map(|(mine, theirs)| mine.common(theirs))
        .filter(|(mine, theirs)| mine.has_r2() && !theirs.is_empty())
        .collect();
    let units: Vec<Vec<usize>> = pairs.iter().map(|(o, _)| o.units(scoring.units)).collect();
    let compared = pairs.iter().zip(&units).map(|((mine, theirs), units)| {
        let (mine_samples, theirs_samples) = (mine.r2_samples(), theirs.r2_samples());
        Ok(Compared {
            metric: mine.r2_metric()?,
            truth: mine_samples.truth,
            first: mine_samples.estimate,
            second: theirs_samples.estimate,
            units: Some(units),
        })
    });
    let difference = compared
        .collect::<Result<Vec<_>, Undefined>>()
        .map_err(BootstrapError::from)
        .and_then(|compared| scoring.bootstrap.mean_difference(&compared));
    match difference {
        Ok(found) => Some(Gain {
            value: found.estimate,
            interval: [found.low, found.high],
        }),
        Err(reason) => {
            notes.add(&format!("gain over {}", other.row.label), &reason);
            None
        }
    }
}
