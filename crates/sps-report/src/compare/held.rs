//! What a run was scored on: its held-out estimates, rerun by rerun.

use std::collections::{BTreeMap, HashMap};

use anyhow::{Context, Result};
use sps_dataset::Unit;
use sps_experiment::predictions::Prediction;
use sps_experiment::results::{Kind, Results};

/// The held-out estimates of a run, by method and property, in the order of the reruns. A rerun whose
/// training failed has none.
pub(crate) struct Outcomes {
    all: BTreeMap<(String, String), Vec<Held>>,
    /// The number of each surface's unit.
    units: HashMap<String, usize>,
    pub unit: Unit,
}

/// Estimates of one property in one rerun, in the order of the surfaces' names.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Held {
    pub rerun: usize,
    pub surfaces: Vec<String>,
    pub truth: Vec<f64>,
    pub estimate: Vec<f64>,
    /// Of the part that each estimate was trained on.
    pub training_mean: Vec<f64>,
}

impl Outcomes {
    /// From the predictions of a run with these results.
    pub(super) fn of(results: &Results, mut predictions: Vec<Prediction>) -> Result<Self> {
        predictions.sort_by(|a, b| a.surface.cmp(&b.surface));
        let mut reruns: BTreeMap<(String, String), BTreeMap<usize, Held>> = BTreeMap::new();
        let (mut units, mut numbers) = (HashMap::new(), HashMap::new());
        for one in predictions {
            let (rerun, training_mean) = trained(results, &one).with_context(|| {
                format!(
                    "results.json has no `training_means` of method {}, property {}, split {}, which \
                     predictions.csv has",
                    one.method, one.property, one.rerun
                )
            })?;
            let is_alone = one.group.is_empty();
            let unit = if is_alone { &one.surface } else { &one.group };
            let next = numbers.len();
            let number = *numbers.entry(unit.clone()).or_insert(next);
            units.insert(one.surface.clone(), number);
            let of_method = reruns.entry((one.method, one.property)).or_default();
            let held = of_method.entry(rerun).or_default();
            held.rerun = rerun;
            held.surfaces.push(one.surface);
            held.truth.push(one.truth);
            held.estimate.push(one.estimate);
            held.training_mean.push(training_mean);
        }
        let all = reruns.into_iter();
        let all = all.map(|(of, reruns)| (of, reruns.into_values().collect()));
        Ok(Self {
            all: all.collect(),
            units,
            unit: results.dataset.unit.unwrap_or(Unit::Surface),
        })
    }

    pub(super) fn units_of(&self, held: &Held) -> Vec<usize> {
        let unit = |surface: &String| self.units.get(surface).copied().unwrap_or(usize::MAX);
        held.surfaces.iter().map(unit).collect()
    }

    /// Those of one method and property with their reruns; empty where there is none.
    pub(super) fn get(&self, method: &str, property: &str) -> &[Held] {
        let found = self.all.get(&(method.to_owned(), property.to_owned()));
        found.map(Vec::as_slice).unwrap_or_default()
    }
}

/// The rerun that an estimate belongs to, and the mean of the part that it was trained on.
fn trained(results: &Results, one: &Prediction) -> Option<(usize, f64)> {
    let method = results.method(&one.method)?;
    let means = method.training_means.get(&one.property)?;
    let of_rerun = (means.len() / method.reruns.max(1)).max(1);
    Some((one.rerun / of_rerun, *means.get(one.rerun)?))
}

impl Held {
    /// Values as a score takes them.
    pub(super) fn judged(&self, kind: Kind) -> [Vec<f64>; 2] {
        [&self.truth, &self.estimate].map(|values| {
            let values = values.iter().zip(&self.training_mean);
            let mean = |mean: f64| if kind.is_about_training() { mean } else { 0.0 };
            values.map(|(value, of)| value - mean(*of)).collect()
        })
    }

    /// Whether both are of the same surfaces with the same readings.
    pub(super) fn pairs_with(&self, other: &Self) -> bool {
        self.surfaces == other.surfaces && self.truth == other.truth
    }
}
