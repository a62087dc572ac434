//! `benches/budgets.toml`: how far a number may move.

use std::path::Path;

use anyhow::{Result, ensure};
use serde::Deserialize;
use sps_experiment::files::read_text;

pub(crate) const FILE: &str = "benches/budgets.toml";

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Budgets {
    pub instructions: Instructions,
    pub scores: Scores,
    #[serde(rename = "ratio")]
    pub ratios: Vec<Ratio>,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Instructions {
    /// How many more there may be, as a share of the baseline's.
    pub more: f64,
}

/// A score may differ by `absolute` plus `relative` times the baseline's.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Scores {
    pub absolute: f64,
    pub relative: f64,
}

impl Scores {
    /// How far a score may lie from `then`.
    pub(crate) fn around(&self, then: f64) -> f64 {
        self.absolute + self.relative * then.abs()
    }
}

/// The time of one benchmark over that of another of the same run, for one element each.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Ratio {
    pub name: String,
    pub of: String,
    pub over: String,
    /// How much larger it may be, as a share of the baseline's.
    pub more: f64,
}

impl Budgets {
    pub(crate) fn read() -> Result<Self> {
        let path = Path::new(FILE);
        let budgets: Self = sps_dataset::parse_toml(path, &read_text(path)?)?;
        let (instructions, scores) = (budgets.instructions.more, &budgets.scores);
        let shares = budgets.ratios.iter().map(|ratio| ratio.more);
        for share in shares.chain([instructions, scores.absolute, scores.relative]) {
            ensure!(
                share.is_finite() && share >= 0.0,
                "{FILE}: a budget of {share}, expected at least 0"
            );
        }
        Ok(budgets)
    }
}
