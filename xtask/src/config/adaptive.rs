//! When a method that looks at one view after the other has looked enough.

use serde::Serialize;
use sps_metrics::Level;

use super::looks::{Looks, Problem};
use super::schema::{MethodConfig, SelectorConfig};

/// Stops at the first number of views whose interval is narrow enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Adaptive {
    /// In standard deviations of the training readings.
    pub width: f64,
    pub level: Level,
    /// Share of the training surfaces that the intervals are calibrated on.
    pub calibration: f64,
}

/// An [`Adaptive`] as it enters keys.
#[derive(Serialize)]
pub(crate) struct AdaptiveKey {
    width: f64,
    level: f64,
    calibration: f64,
}

impl Adaptive {
    pub(crate) fn key(&self) -> AdaptiveKey {
        AdaptiveKey {
            width: self.width,
            level: self.level.get(),
            calibration: self.calibration,
        }
    }
}

/// What the config of a method says of it.
pub(super) fn of(method: &MethodConfig, looks: &Looks) -> Result<Option<Adaptive>, Problem> {
    let Some(adaptive) = method.adaptive else {
        return Ok(None);
    };
    let refused = |problem: &str| Err(("adaptive", problem.to_owned()));
    let Looks::Selected(selected) = looks else {
        return refused("needs a `selector`, and `views` that says how many at most");
    };
    // Whatever has seen the readings of the calibration surfaces is surer of them than of others.
    if selected.learns() {
        return refused("needs a selector that learns nothing: its intervals would be too narrow");
    }
    if method.encoder.trainable {
        return refused("needs an encoder that is not trained: its intervals would be too narrow");
    }
    if !(adaptive.width.is_finite() && adaptive.width > 0.0) {
        return Err(("adaptive.width", "must be above 0".to_owned()));
    }
    if !(adaptive.calibration > 0.0 && adaptive.calibration < 1.0) {
        return Err((
            "adaptive.calibration",
            "must lie between 0 and 1".to_owned(),
        ));
    }
    let level =
        Level::new(adaptive.level).map_err(|error| ("adaptive.level", error.to_string()))?;
    Ok(Some(Adaptive {
        width: adaptive.width,
        level,
        calibration: adaptive.calibration,
    }))
}

/// The picks of a selector in the order in which they are looked at. Most selectors have an order;
/// equidistant views lie from one end to the other, so each next one is that farthest from those
/// before it, beginning in the middle.
pub(crate) fn in_order(selector: &SelectorConfig, mut picks: Vec<usize>) -> Vec<usize> {
    if !matches!(selector, SelectorConfig::Equidistant(_)) || picks.is_empty() {
        return picks;
    }
    let mut ordered = vec![picks.remove((picks.len() - 1) / 2)];
    while !picks.is_empty() {
        let distance = |view: usize| ordered.iter().map(|&other| view.abs_diff(other)).min();
        let mut farthest = 0;
        for at in 1..picks.len() {
            if distance(picks[at]) > distance(picks[farthest]) {
                farthest = at;
            }
        }
        ordered.push(picks.remove(farthest));
    }
    ordered
}

#[cfg(test)]
mod tests {
    use super::*;
    use sps_viewselect::{Equidistant, Nadir};

    #[test]
    fn equidistant_views_spread_from_the_middle() {
        let equidistant = SelectorConfig::Equidistant(Equidistant::default());
        let ordered = in_order(&equidistant, vec![10, 30, 50, 70, 90]);
        assert_eq!(ordered, [50, 10, 90, 30, 70]);
        let nadir = SelectorConfig::Nadir(Nadir::default());
        assert_eq!(in_order(&nadir, vec![50, 49, 51]), [50, 49, 51]);
    }
}
