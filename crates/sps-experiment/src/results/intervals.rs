//! How the intervals fared that came with estimates.

use serde::{Deserialize, Serialize};
use sps_metrics::{Coverage, PredictionInterval, coverage};

use super::{Judged, MethodOutcomes, Number, PerProperty, Scoring};

/// Over all held-out readings of all reruns.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct GivenIntervals {
    /// Per property, the share of truths that the intervals held.
    pub coverage: PerProperty<f64>,
    /// Over all properties.
    pub coverage_mean: f64,
    /// Per property, in its own unit.
    pub mean_width: PerProperty<f64>,
    /// Per property, over the standard deviation of its values over all surfaces.
    pub mean_width_over_std: PerProperty<Number>,
    /// Over all properties.
    pub mean_width_over_std_mean: Number,
}

impl GivenIntervals {
    /// `None` where the estimates have no intervals, or their method made these itself.
    pub(super) fn of(method: &MethodOutcomes<'_>, scoring: &Scoring<'_>) -> Option<Self> {
        if method.adaptive.is_some() {
            return None;
        }
        let mut all = Self::default();
        for (property, trials) in &method.outcomes {
            let Some(found) = held(trials) else {
                continue;
            };
            let deviation = scoring.deviations.get(property).filter(|std| **std > 0.0);
            let over_std = deviation.map(|std| found.mean_width / std);
            all.coverage.insert(property.clone(), found.fraction());
            all.mean_width.insert(property.clone(), found.mean_width);
            all.mean_width_over_std.insert(property.clone(), over_std);
        }
        if all.coverage.is_empty() {
            return None;
        }
        let count = all.coverage.len() as f64;
        all.coverage_mean = all.coverage.values().sum::<f64>() / count;
        let widths: Number = all.mean_width_over_std.values().copied().sum();
        all.mean_width_over_std_mean = widths.map(|sum| sum / count);
        Some(all)
    }
}

/// What the intervals of some trials hold, and how wide they are; `None` where there are none.
pub(super) fn held<'a: 't, 't>(
    trials: impl IntoIterator<Item = &'t Judged<'a>, IntoIter: Clone>,
) -> Option<Coverage> {
    let trials = trials.into_iter();
    let intervals = trials.clone().flat_map(Judged::stops);
    let intervals = intervals.map(|stop| PredictionInterval {
        low: stop.low,
        high: stop.high,
    });
    let truth: Vec<f64> = trials.flat_map(Judged::truth).copied().collect();
    coverage(&intervals.collect::<Vec<_>>(), &truth).ok()
}
