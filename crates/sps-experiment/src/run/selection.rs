//! What selectors found, beside each other.

use sps_dataset::RollAngle;
use sps_viewselect::AnySelector;

use super::found::Found;
use super::results::MethodRow;
use crate::config::Method;
use crate::results::{PerProperty, SelectionResult};

/// The selections of one row, by property, in the order of the reruns. Regrets are counted from
/// the exhaustive search among `rows` that searched the same estimators.
pub(super) fn summaries(
    row: &MethodRow<'_>,
    rows: &[MethodRow<'_>],
    angles: &[RollAngle],
) -> PerProperty<Vec<SelectionResult>> {
    let optima = rows
        .iter()
        .find(|other| is_optimum(row.method, other.method));
    let of_property = |(property, found): (&String, &Vec<Found>)| {
        let optima = optima.and_then(|row| row.found.get(property));
        let results = found.iter().enumerate().map(|(rerun, found)| {
            summary(found, optima.and_then(|optima| optima.get(rerun)), angles)
        });
        (property.clone(), results.collect())
    };
    row.found.iter().map(of_property).collect()
}

/// Whether `other` found the best of the sets that `method` could choose from.
fn is_optimum(method: &Method, other: &Method) -> bool {
    let Some((one, two)) = method.selected().zip(other.selected()) else {
        return false;
    };
    let heads = method.estimator.head().zip(other.estimator.head());
    let same_loss = match (&one.refit, &two.refit) {
        (None, None) => heads.is_some_and(|(one, two)| one == two),
        (one, two) => one == two,
    };
    let exhaustive = matches!(two.selector, AnySelector::Exhaustive(_));
    let same_encoder = method.encoder == other.encoder;
    same_encoder && same_loss && exhaustive && one.distinct == two.distinct
}

fn summary(found: &Found, optimum: Option<&Found>, angles: &[RollAngle]) -> SelectionResult {
    let selection = &found.selection;
    let loss = found.random_loss.map(|_| selection.loss);
    let optimum_loss = optimum.map(|optimum| optimum.selection.loss);
    let regret = found.random_loss.zip(optimum_loss);
    SelectionResult {
        loss,
        random_loss: found.random_loss,
        optimum_loss,
        regret: regret.and_then(|(random, optimum)| selection.regret(random, optimum)),
        mean_angle_between_deg: mean_angle(&selection.picks, angles),
        evaluations: selection.evaluations,
        computed: selection.computed,
        seconds: selection.seconds,
        curve: selection
            .curve
            .iter()
            .map(|point| (point.evaluations, point.mean, point.best))
            .collect(),
    }
}

fn mean_angle(picks: &[usize], angles: &[RollAngle]) -> Option<f64> {
    let mut sum = 0.0;
    let mut pairs = 0;
    for (at, &one) in picks.iter().enumerate() {
        for &other in &picks[at + 1..] {
            sum += (angles.get(one)?.0 - angles.get(other)?.0).abs();
            pairs += 1;
        }
    }
    (pairs > 0).then(|| sum / f64::from(pairs))
}
