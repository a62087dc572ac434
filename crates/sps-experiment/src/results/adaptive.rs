//! How methods fared that look at no more views than they need.

use serde::{Deserialize, Serialize};

use super::intervals::held;
use super::{Judged, MethodOutcomes};
use crate::config::Adaptive;
use crate::journal::Stop;

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
    /// `None` where nothing was estimated.
    pub(super) fn of(method: &MethodOutcomes<'_>, asked: Adaptive) -> Option<Self> {
        let stops: Vec<Stop> = method.trials().flat_map(Judged::stops).collect();
        let covered = held(method.outcomes.values().flatten())?;
        let count = stops.len() as f64;
        let share = |holds: &dyn Fn(&Stop) -> bool| {
            stops.iter().filter(|stop| holds(stop)).count() as f64 / count
        };
        let mean = |of: fn(&Stop) -> f64| stops.iter().map(of).sum::<f64>() / count;
        let most = method.all_folds().map(|fold| fold.views.len()).max()?;
        let shares = (1..=most).map(|views| share(&|stop| stop.views == views));
        Some(Self {
            width: asked.width,
            level: asked.level.get(),
            mean_views: mean(|stop| stop.views as f64),
            share_of_views: shares.collect(),
            narrow: share(&|stop| stop.width.is_some_and(|width| width <= asked.width)),
            mean_width: mean(|stop| stop.width.unwrap_or_default()),
            coverage: covered.fraction(),
        })
    }
}
