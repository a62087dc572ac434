//! What differs between finished runs: configs, sources, data, machines, scores and times.

mod differing;
mod held;
mod moved;
mod run;
mod speed;
mod tables;

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Result, ensure};
use serde::Serialize;
use sps_experiment::results::{Kind, MethodResult};

use crate::table::Cell;
use differing::Aspect;
use moved::Moved;
pub use run::Run;
use speed::Speeds;

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

/// Sets `second` beside `first`, whose level the intervals have.
///
/// # Errors
/// Runs without a method in common.
pub fn compare(first: &Run, second: &Run) -> Result<Comparison> {
    let (only_first, only_second) = (lacking(first, second), lacking(second, first));
    let common: Vec<[&MethodResult; 2]> = in_both(first, second).collect();
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
        aspects: differing::aspects(first, second),
        only_first,
        only_second,
        interval_level: first.results.interval_level,
        units: first.outcomes.unit.max(second.outcomes.unit).to_string(),
        scores: moved::scores(first, second, &common),
        speed: common.into_iter().map(Speeds::of).collect(),
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

/// The methods of these ids in either run, in the order of the first.
fn in_both<'r>(first: &'r Run, second: &'r Run) -> impl Iterator<Item = [&'r MethodResult; 2]> {
    let methods = first.results.methods.iter();
    methods.filter_map(|method| Some([method, second.results.method(&method.id)?]))
}

/// The ids of methods that `one` has and `other` lacks.
fn lacking(one: &Run, other: &Run) -> Vec<String> {
    let there: BTreeSet<&String> = other.results.methods.iter().map(|m| &m.id).collect();
    let ids = one.results.methods.iter().map(|method| &method.id);
    ids.filter(|id| !there.contains(id)).cloned().collect()
}
