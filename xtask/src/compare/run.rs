//! A finished run, as it is compared.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use sps_metrics::{Bootstrap, Level};

use super::held::Outcomes;
use crate::checksums;
use crate::files::read_text;
use crate::report::predictions;
use crate::results::Results;
use crate::run::{CONFIG, RunFolder};

/// The first version of `results.json` that has the means that R² is about.
const LEAST_SCHEMA: u32 = 2;

/// What a run left in its folder.
pub(crate) struct Run {
    pub path: PathBuf,
    /// Every key of its config.
    pub config: toml::Table,
    pub results: Results,
    pub outcomes: Outcomes,
    /// Of its intervals.
    pub resamples: usize,
    level: Level,
}

impl Run {
    /// Reads a finished run, waiting for one that is at work in its folder.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let folder = RunFolder::finished(path)?;
        checksums::ensure_finished(path, &[CONFIG])?;
        let file = folder.file(CONFIG);
        let config: toml::Table = sps_dataset::parse_toml(&file, &read_text(&file)?)?;
        let results = Results::read(path)?;
        let schema = results.provenance.schema;
        ensure!(
            schema >= LEAST_SCHEMA,
            "{}: `schema` is {schema}, expected at least {LEAST_SCHEMA}: runs are compared by what \
             older ones did not write; `cargo xtask experiment` writes it again",
            folder.file("results.json").display()
        );
        let resamples = resamples(&config).with_context(|| {
            format!(
                "{}: `report.resamples` is no number of resamples",
                file.display()
            )
        })?;
        Ok(Self {
            path: path.to_owned(),
            outcomes: Outcomes::of(&results, predictions::read(path)?)
                .with_context(|| format!("{} cannot be compared", path.display()))?,
            level: Level::new(results.interval_level).with_context(|| {
                format!(
                    "{}: `interval_level`",
                    folder.file("results.json").display()
                )
            })?,
            config,
            results,
            resamples,
        })
    }

    /// As its own intervals are drawn.
    pub(super) fn bootstrap(&self) -> Bootstrap {
        Bootstrap::new(self.results.provenance.seed)
            .with_resamples(self.resamples)
            .with_level(self.level)
    }
}

fn resamples(config: &toml::Table) -> Option<usize> {
    let report = config.get("report")?.as_table()?;
    usize::try_from(report.get("resamples")?.as_integer()?).ok()
}
