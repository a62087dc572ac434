//! Fitting to photographs of one's own, without a config.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use sps_dataset::{DatasetFolder, ReadSettings, Source};

use crate::config::{Experiment, Setting};
use crate::results::Results;
use crate::run::{self, RunFolder};
use crate::train::{self, Say, Trained};

const CONFIG: &str = include_str!("own.toml");
/// Parts of the surfaces or groups, each held out once, where there are as many.
const FOLDS: usize = 10;

/// Methods, scored on surfaces held out, and the best of them.
pub struct Chosen {
    /// Where their scores are.
    pub run: RunFolder,
    /// The same.
    pub results: Results,
    /// The id of the method whose R² is the highest.
    pub method: String,
    experiment: Experiment,
}

impl Chosen {
    /// Scores methods on the dataset in `data` and chooses the best; the run goes to the folder `run`
    /// and is called `name`. `settings` are laid over the config.
    ///
    /// # Errors
    /// As [`run::run`]; where nothing can be held out or no method was scored.
    pub fn of(data: &Path, name: &str, settings: Vec<Setting>, run: &Path) -> Result<Self> {
        let source = DatasetFolder::open(data, &ReadSettings::default())?;
        let surfaces = source.surfaces().iter();
        let groups: BTreeSet<&str> = surfaces.map(|surface| &*surface.group).collect();
        ensure!(
            groups.len() > 1,
            "{}: found one group, expected at least two, to hold one out",
            data.display()
        );
        let folds = groups.len().min(FOLDS) as i64;
        let mut all = vec![
            Setting::new("data.folder.path", data.display().to_string()),
            Setting::new("split.k-fold.folds", folds),
        ];
        all.extend(settings);
        let read = |settings: &[Setting]| Experiment::parse(Path::new(name), CONFIG, settings);
        let (run, results) = run::run(&read(&all)?, run, true)?;
        let best = results.best().context("no method was scored")?.id.clone();
        all.push(Setting::new("train.method", best.clone()));
        Ok(Self {
            run,
            results,
            method: best,
            experiment: read(&all)?,
        })
    }

    /// Fits the chosen method to all surfaces.
    ///
    /// # Errors
    /// As [`train::train`].
    pub fn train(&self, say: Say<'_>) -> Result<Trained> {
        train::train(&self.experiment, say)
    }
}
