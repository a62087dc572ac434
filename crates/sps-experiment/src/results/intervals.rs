//! How intervals fared: those that came with estimates, and those of methods that look at one view after another
//! ([`AdaptiveResult`]).

use serde::{Deserialize, Serialize};
use sps_metrics::{Coverage, PredictionInterval, coverage};

use super::{Judged, MethodOutcomes, Number, PerProperty, Scoring};
use crate::journal::Stop;

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

/// Over all held-out surfaces of all properties and reruns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct AdaptiveResult {
    /// The width asked for, in standard deviations of the training readings.
    pub width: f64,
    /// The share of truths that the intervals are to hold.
    pub level: f64,
    /// Views that were looked at, on average.
    pub mean_views: f64,
    /// The share of estimates that took one view, two, and so on.
    pub share_of_views: Vec<f64>,
    /// The share of estimates whose interval is as narrow as asked for.
    pub narrow: f64,
    /// In the unit of `width`.
    pub mean_width: f64,
    /// The share of truths that the intervals held.
    pub coverage: f64,
}

impl AdaptiveResult {
    /// `None` where nothing was estimated, or all views are looked at.
    pub(super) fn of(method: &MethodOutcomes<'_>) -> Option<Self> {
        let asked = method.adaptive?;
        let stops: Vec<Stop> = method.trials().flat_map(Judged::stops).collect();
        let covered = held(method.outcomes.values().flatten())?;
        let count = stops.len() as f64;
        let share =
            |views: usize| stops.iter().filter(|stop| stop.views == views).count() as f64 / count;
        let widths = stops.iter().map(|stop| stop.width);
        let widths: Vec<f64> = widths.collect::<Option<_>>()?;
        let views: f64 = stops.iter().map(|stop| stop.views as f64).sum();
        let narrow = widths.iter().filter(|width| **width <= asked.width);
        let most = method.all_folds().map(|fold| fold.views.len()).max()?;
        Some(Self {
            width: asked.width,
            level: asked.level.get(),
            mean_views: views / count,
            share_of_views: (1..=most).map(share).collect(),
            narrow: narrow.count() as f64 / count,
            mean_width: widths.iter().sum::<f64>() / count,
            coverage: covered.fraction(),
        })
    }
}

/// What the intervals of some trials hold, and how wide they are; `None` where there are none.
fn held<'a: 't, 't>(
    trials: impl IntoIterator<Item = &'t Judged<'a>, IntoIter: Clone>,
) -> Option<Coverage> {
    let trials = trials.into_iter();
    let intervals = trials.clone().flat_map(Judged::stops);
    let intervals = intervals.map(|stop| PredictionInterval {
        low: stop.low,
        high: stop.high,
    });
    let truth = trials.flat_map(|judged| judged.samples().truth);
    let truth: Vec<f64> = truth.copied().collect();
    coverage(&intervals.collect::<Vec<_>>(), &truth).ok()
}
