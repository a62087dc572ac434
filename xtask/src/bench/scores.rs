//! The scores of a finished run.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, ensure};
use sps_experiment::results::Kind;
use sps_report::compare::Run;

/// Every score that has a mean over properties, of every method and property, in each rerun.
pub(crate) fn of_run(folder: &Path) -> Result<BTreeMap<String, Vec<f64>>> {
    let run = Run::read(folder)?;
    let mut scores = BTreeMap::new();
    for method in &run.results.methods {
        for property in &run.results.properties {
            for kind in Kind::WITH_MEANS {
                let name = format!("{}: {} {property}", method.id, kind.name());
                scores.insert(name, run.scores(kind, &method.id, property));
            }
        }
    }
    ensure!(!scores.is_empty(), "{} has no scores", folder.display());
    Ok(scores)
}
