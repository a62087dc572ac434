//! When a method that looks at one view after the other has looked enough.

use sps_viewselect::AnySelector;

use super::looks::{Looks, Problem, refuse};
use super::schema::{Adaptive, MethodConfig};

pub(super) fn of(method: &MethodConfig, looks: &Looks) -> Result<Option<Adaptive>, Problem> {
    let Some(adaptive) = method.adaptive else {
        return Ok(None);
    };
    let Looks::Selected(selected) = looks else {
        let why = "needs a number of `views` above 1, which says how many at most";
        return refuse("adaptive", why);
    };
    // Whatever has seen the readings of the calibration surfaces is surer of them than of others.
    if selected.selector.learns() {
        let why = "needs a selector that learns nothing: its intervals would be too narrow";
        return refuse("adaptive", why);
    }
    if method.encoder.trainable {
        let why = "needs an encoder that is not trained: its intervals would be too narrow";
        return refuse("adaptive", why);
    }
    if !(adaptive.width.is_finite() && adaptive.width > 0.0) {
        return refuse("adaptive.width", "must be above 0");
    }
    if !(adaptive.calibration > 0.0 && adaptive.calibration < 1.0) {
        return refuse("adaptive.calibration", "must lie between 0 and 1");
    }
    Ok(Some(adaptive))
}

/// The picks of a selector in the order in which they are looked at. Most selectors have an order;
/// equidistant views lie from one end to the other, so each next one is that farthest from those
/// before it, beginning in the middle.
pub(crate) fn in_order(selector: &AnySelector, mut picks: Vec<usize>) -> Vec<usize> {
    if !matches!(selector, AnySelector::Equidistant(_)) || picks.is_empty() {
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
        let equidistant = AnySelector::Equidistant(Equidistant::default());
        let ordered = in_order(&equidistant, vec![10, 30, 50, 70, 90]);
        assert_eq!(ordered, [50, 10, 90, 30, 70]);
        let nadir = AnySelector::Nadir(Nadir::default());
        assert_eq!(in_order(&nadir, vec![50, 49, 51]), [50, 49, 51]);
    }
}
