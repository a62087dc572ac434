//! How much the means of a method differ from rerun to rerun.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use sps_metrics::{Outcome, PropertyMean, PropertyScore, Scores, mean_over_all, mean_over_named};

use super::score::listed;
use super::{MethodOutcomes, Number, PerProperty, Scoring};

/// The lowest and the highest value of the reruns; `null` where a rerun has none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Ranges {
    pub r2_mean: Option<[f64; 2]>,
    pub mae_mean: Option<[f64; 2]>,
    pub median_percent_error_mean: Option<[f64; 2]>,
    pub median_percent_error_top8: Option<[f64; 2]>,
}

pub(super) fn over_reruns(method: &MethodOutcomes<'_>, scoring: &Scoring<'_>) -> Ranges {
    let of_rerun = |rerun: usize| -> PerProperty<Scores> {
        let outcomes = method.outcomes.iter();
        let scored = outcomes
            .filter_map(|(property, all)| Some((property.clone(), all.get(rerun)?.scores())));
        scored.collect()
    };
    let reruns: Vec<PerProperty<Scores>> = (0..method.reruns).map(of_rerun).collect();
    let range = |of: fn(&Scores) -> Number, mean: &dyn Fn(&[PropertyScore]) -> PropertyMean| {
        let values = reruns.iter().map(|scores| {
            let values = scores.iter().map(|(property, s)| (property.clone(), of(s)));
            let values: BTreeMap<String, Number> = values.collect();
            let mean = mean(&listed(&values, scoring.properties));
            mean.is_complete().then_some(mean.value.ok()).flatten()
        });
        let values = values.collect::<Option<Vec<f64>>>()?;
        let low = values.iter().copied().reduce(f64::min)?;
        Some([low, values.iter().copied().reduce(f64::max)?])
    };
    let all: &dyn Fn(&[PropertyScore]) -> PropertyMean = &mean_over_all;
    let percent = |s: &Scores| {
        s.median_percent_error
            .as_ref()
            .ok()
            .map(|score| score.value)
    };
    Ranges {
        r2_mean: range(|s| value(&s.r2), all),
        mae_mean: range(|s| value(&s.mae), all),
        median_percent_error_mean: range(percent, all),
        median_percent_error_top8: range(percent, &|scores| mean_over_named(scores, scoring.top8)),
    }
}

fn value(outcome: &Outcome) -> Number {
    outcome.as_ref().ok().map(|score| score.value)
}
