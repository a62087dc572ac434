//! A finished run, as it is compared.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use sps_experiment::checksums;
use sps_experiment::files::read_text;
use sps_experiment::predictions;
use sps_experiment::results::{Kind, Results};
use sps_experiment::run::{CONFIG, RunFolder};
use sps_metrics::{Intervals, Level, Samples};

use super::held::Outcomes;

/// What a run left in its folder.
pub struct Run {
    /// Its folder.
    pub path: PathBuf,
    pub(crate) config: toml::Table,
    /// Its `results.json`.
    pub results: Results,
    pub(crate) outcomes: Outcomes,
    /// As its own intervals are made.
    pub(crate) intervals: Intervals,
}

impl Run {
    /// Reads a finished run, waiting for one that is at work in its folder.
    ///
    /// # Errors
    /// What is not the folder of a finished run; files that are damaged.
    pub fn read(path: &Path) -> Result<Self> {
        let folder = RunFolder::finished(path)?;
        checksums::ensure_finished(path, &[CONFIG])?;
        let file = folder.file(CONFIG);
        let config: toml::Table = sps_dataset::parse_toml(&file, &read_text(&file)?)?;
        let results = Results::read(path)?;
        let level = Level::new(results.interval_level).with_context(|| {
            format!(
                "{}: `interval_level`",
                folder.file("results.json").display()
            )
        })?;
        let shared = results.test_per_training.unwrap_or_default();
        Ok(Self {
            path: path.to_owned(),
            outcomes: Outcomes::of(&results, predictions::read(path)?)
                .with_context(|| format!("{} cannot be compared", path.display()))?,
            intervals: Intervals::of_training(level).sharing(shared),
            config,
            results,
        })
    }

    /// The score of a method for a property in each rerun that has one.
    pub fn scores(&self, kind: Kind, method: &str, property: &str) -> Vec<f64> {
        let reruns = self.outcomes.get(method, property).iter();
        let scores = reruns.filter_map(|held| {
            let [truth, estimate] = &held.judged(kind);
            let samples = Samples { truth, estimate };
            Some(kind.metric().ok()?.score(samples).ok()?.value)
        });
        scores.collect()
    }
}
