//! What one call measured, and baselines: the same on disk.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use sps_experiment::files::{read_text, write_atomically};
use sps_experiment::results::Kind;
use sps_report::compare::Run;

use super::machine::Machine;

const FOLDER: &str = "benches/baselines";

/// Everything by its name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Measured {
    pub machine: Machine,
    pub ratios: BTreeMap<String, f64>,
    pub instructions: BTreeMap<String, u64>,
    /// Of a finished run, in each rerun that has one.
    pub scores: BTreeMap<String, Vec<f64>>,
    pub wall: BTreeMap<String, Wall>,
}

/// Seconds of one pass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Wall {
    pub median: f64,
    /// Of the median, 95 %, as criterion draws it.
    pub interval: [f64; 2],
    pub shortest: f64,
    /// Frames or other elements of a pass; 1 where the benchmark states none.
    pub elements: f64,
}

impl Measured {
    pub(crate) fn read(name: &str) -> Result<Self> {
        let path = path(name)?;
        serde_json::from_str(&read_text(&path)?)
            .with_context(|| format!("{} is not a baseline", path.display()))
    }

    /// Writes the baseline of that name; says where.
    pub(crate) fn write(&self, name: &str) -> Result<PathBuf> {
        let path = path(name)?;
        let text = serde_json::to_string_pretty(self)? + "\n";
        write_atomically(&path, text.as_bytes())?;
        Ok(path)
    }
}

/// Every score of a finished run that has a mean over properties, of every method and property, in each rerun.
pub(crate) fn scores(folder: &Path) -> Result<BTreeMap<String, Vec<f64>>> {
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

fn path(name: &str) -> Result<PathBuf> {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    ensure!(
        !name.is_empty() && name.chars().all(plain),
        "`{name}` names no baseline, expected letters, digits, `-`, `_` and `.`"
    );
    Ok(PathBuf::from(FOLDER).join(format!("{name}.json")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_stays_in_its_folder() {
        let main = path("main").unwrap();
        assert_eq!(main, PathBuf::from("benches/baselines/main.json"));
        for name in ["", "../main", "a/b", "a b"] {
            assert!(path(name).is_err(), "{name}");
        }
    }
}
