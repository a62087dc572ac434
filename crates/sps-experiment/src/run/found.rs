//! What selectors found, and how much worse that is than what an exhaustive search found.

use std::collections::BTreeMap;

use anyhow::Result;
use serde::{Deserialize, Serialize};
use sps_dataset::{Property, RollAngle};
use sps_viewselect::{AnySelector, Problem, Random, Selection, Selector};

use super::results::MethodRow;
use crate::config::{Method, Selected};
use crate::journal::{Record, TrialKey};
use crate::results::{PerProperty, SelectionResult};

/// Points that are kept of a search's curve.
const CURVE_POINTS: usize = 60;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Found {
    pub key: TrialKey,
    /// Picks are indices of the source's views; losses are in units of the variance of the training
    /// readings.
    pub selection: Selection,
    /// Mean loss of random sets; none where no loss was asked for.
    pub random_loss: Option<f64>,
    /// What it took, with its share of the training of the networks that were asked.
    pub seconds: f64,
}

impl Found {
    /// What the selector finds, beside the mean loss of so many random sets.
    pub(super) fn search(
        key: TrialKey,
        selected: &Selected,
        problem: &Problem<'_>,
        random_sets: usize,
    ) -> Result<Self> {
        let random = Random { draws: random_sets };
        let random = random.select(problem)?;
        Ok(Self {
            key,
            selection: thinned(selected.selector.select(problem)?),
            random_loss: random.curve.first().map(|point| point.mean),
            seconds: 0.0,
        })
    }
}

impl Record for Found {
    fn key(&self) -> &TrialKey {
        &self.key
    }
}

#[derive(Default)]
pub(crate) struct Selections(BTreeMap<(String, Property, usize), Found>);

impl Selections {
    pub(super) fn insert(&mut self, method: &str, property: Property, rerun: usize, found: Found) {
        self.0.insert((method.to_owned(), property, rerun), found);
    }

    pub(crate) fn get(&self, method: &str, property: &Property, rerun: usize) -> Option<&Found> {
        self.0.get(&(method.to_owned(), property.clone(), rerun))
    }
}

/// The selection with a curve of few points, the last among them.
fn thinned(mut selection: Selection) -> Selection {
    let count = selection.curve.len();
    let keep = |at: usize| at * CURVE_POINTS / count != (at + 1) * CURVE_POINTS / count;
    let mut at = 0..;
    if count > CURVE_POINTS {
        selection.curve.retain(|_| at.next().is_some_and(keep));
    }
    selection
}

/// The selections of one row, by property, in the order of the reruns. Regrets are counted from
/// the exhaustive search among `rows` that searched the same estimators.
pub(super) fn summaries(
    row: &MethodRow<'_>,
    rows: &[MethodRow<'_>],
    angles: &[RollAngle],
) -> PerProperty<Vec<SelectionResult>> {
    let is_optimum = |other: &&MethodRow<'_>| is_optimum(row.method, other.method);
    let optima = rows.iter().find(is_optimum);
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
    let (selection, curve) = (&found.selection, found.selection.curve.iter());
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
        curve: curve
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
