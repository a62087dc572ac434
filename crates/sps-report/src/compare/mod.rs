//! What differs between finished runs: configs, sources, data, machines, scores and times.

mod held;
mod moved;
mod run;
mod tables;

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Result, ensure};
use serde::Serialize;
use sps_experiment::config::{Differing, differing_keys};
use sps_experiment::results::{Kind, MethodResult, Number, Results};

use crate::table::Cell;
use moved::Moved;
pub use run::Run;

/// One run set beside the first.
#[derive(Debug, Serialize)]
pub struct Comparison {
    pub(crate) first: PathBuf,
    pub(crate) second: PathBuf,
    pub(crate) aspects: Vec<Aspect>,
    /// Ids of methods that only one of them has.
    pub(crate) only_first: Vec<String>,
    pub(crate) only_second: Vec<String>,
    pub(crate) interval_level: f64,
    /// What they are over, in the plural.
    pub(crate) units: String,
    pub(crate) scores: Vec<Moved>,
    pub(crate) speed: Vec<Speeds>,
}

/// One side of what a run depends on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Aspect {
    pub name: &'static str,
    /// Empty where it is the same in both.
    pub differing: Vec<Differing>,
}

/// What the estimate of one surface costs in each run, and what it is worth.
#[derive(Debug, Serialize)]
pub(crate) struct Speeds {
    pub method: String,
    /// The share of variance left unexplained, 1 - R², on average over properties.
    pub error: [Number; 2],
    pub frames_encoded_per_surface: [f64; 2],
    pub predict_seconds_per_surface: [Number; 2],
    /// The seconds of the second run as a multiple of the first's.
    pub times: Number,
}

/// Sets `second` beside `first`, whose level the intervals have.
///
/// # Errors
/// Runs without a method in common.
pub fn compare(first: &Run, second: &Run) -> Result<Comparison> {
    let (only_first, only_second) = (lacking(first, second), lacking(second, first));
    let methods = first.results.methods.iter();
    let common = methods.filter_map(|method| Some([method, second.results.method(&method.id)?]));
    let common: Vec<[&MethodResult; 2]> = common.collect();
    ensure!(
        !common.is_empty(),
        "{} and {} have no method in common: {}, and {}",
        first.path.display(),
        second.path.display(),
        only_first.join(", "),
        only_second.join(", ")
    );
    Ok(Comparison {
        first: first.path.clone(),
        second: second.path.clone(),
        aspects: aspects(first, second),
        only_first,
        only_second,
        interval_level: first.results.interval_level,
        units: first.outcomes.unit.max(second.outcomes.unit).to_string(),
        scores: moved::scores(first, second, &common),
        speed: common.into_iter().map(speeds).collect(),
    })
}

impl Comparison {
    /// R² of methods and properties that the second run has no longer, or that moved by more than
    /// `tolerance`.
    pub fn past(&self, tolerance: f64) -> Vec<String> {
        let lost = self.only_first.iter();
        let lost = lost.map(|method| format!("{method}: R² (not measured)"));
        let of_r2 = self.scores.iter();
        let past = of_r2.filter(|one| one.table() == Some(Kind::R2) && one.is_past(tolerance));
        let past = past.map(|one| {
            let property = one.property.as_deref().unwrap_or_default();
            let by = match one.difference {
                Some(_) => Cell::difference(one.difference, one.interval, 4).to_string(),
                None => "not measured".to_owned(),
            };
            format!("{}: R² {property} ({by})", one.method)
        });
        lost.chain(past).collect()
    }
}

fn speeds(methods: [&MethodResult; 2]) -> Speeds {
    let seconds = methods.map(|method| method.costs.predict_seconds_per_surface);
    let times = seconds[0].zip(seconds[1]);
    let times = times.filter(|(first, _)| *first > 0.0);
    Speeds {
        method: methods[0].id.clone(),
        error: methods.map(|method| method.means.r2_mean.map(|r2| 1.0 - r2)),
        frames_encoded_per_surface: methods.map(|m| m.costs.frames_encoded_per_surface),
        predict_seconds_per_surface: seconds,
        times: times.map(|(first, second)| second / first),
    }
}

/// The ids of methods that `one` has and `other` lacks.
fn lacking(one: &Run, other: &Run) -> Vec<String> {
    let there: BTreeSet<&String> = other.results.methods.iter().map(|m| &m.id).collect();
    let ids = one.results.methods.iter().map(|method| &method.id);
    ids.filter(|id| !there.contains(id)).cloned().collect()
}

/// Config, sources, data and machine.
fn aspects(first: &Run, second: &Run) -> Vec<Aspect> {
    let differs = |key: &str, of: fn(&Results) -> String| {
        let [first, second] = [first, second].map(|run| of(&run.results));
        (first != second).then(|| Differing {
            key: key.to_owned(),
            first: Some(first),
            second: Some(second),
        })
    };
    let sources = [differs("source_hash", |r| r.provenance.source_hash.clone())];
    let data = [
        differs("data_hash", |r| r.provenance.data_hash.clone()),
        differs("name", |r| r.dataset.name.clone()),
        differs("surfaces", |r| r.dataset.surfaces.to_string()),
        differs("units", |r| r.dataset.units.to_string()),
        differs("views", |r| r.dataset.views.to_string()),
    ];
    let machine = [
        differs("cpu", |r| r.provenance.cpu.clone()),
        differs("threads", |r| r.provenance.threads.to_string()),
    ];
    let aspect = |name, differing| Aspect { name, differing };
    vec![
        aspect("config", differing_keys(&first.config, &second.config)),
        aspect("sources", sources.into_iter().flatten().collect()),
        aspect("data", data.into_iter().flatten().collect()),
        aspect("machine", machine.into_iter().flatten().collect()),
    ]
}
