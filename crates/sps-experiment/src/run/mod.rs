//! Running an experiment: embed, fit what is missing, score, report.

mod adaptive;
mod costs;
mod deal;
mod encoded;
mod encodings;
mod estimates;
mod fit;
mod floors;
mod folder;
mod found;
mod frozen;
mod held_out;
mod outlook;
mod prepared;
mod provenance;
mod refit;
mod results;
mod select;
mod shards;
mod splits;
mod stage;
mod tables;
mod trials;
pub(crate) mod views;

use std::path::{Path, PathBuf};

use anyhow::Result;

pub(crate) use deal::Dealt;
pub(crate) use encoded::Encoded;
pub(crate) use encodings::Encodings;
pub(crate) use estimates::Estimates;
pub use folder::{CONFIG, RunFolder};
pub(crate) use found::Selections;
pub(crate) use frozen::Folds;
pub(crate) use held_out::{portion, what_is_measured};
pub use outlook::outlook;
pub use shards::run as shard;
pub(crate) use splits::Splits;
pub(crate) use stage::{Stage, Stages};
pub(crate) use tables::Tables;

use crate::config::{EncoderSpec, Experiment, Method};
use crate::data;
use crate::journal::{Journal, Outcome};
use crate::predictions;
use crate::results::Results;
use found::Found;
use prepared::Prepared;
use results::results;
use shards::Merged;

/// Runs the experiment into `folder`, or finishes what was begun there, in shards or not; `fresh`
/// begins again. The folder stays locked: a report of the results may follow.
///
/// # Errors
/// Data or weights that cannot be read, methods that do not fit the data, a folder that cannot be written to.
pub fn run(experiment: &Experiment, folder: &Path, fresh: bool) -> Result<(RunFolder, Results)> {
    finish(experiment, folder, fresh, None)
}

/// Makes the results, in `folder`, of an experiment that was done in shards, below the folders of the
/// given runs.
///
/// # Errors
/// Shards that are missing, have not ended, or are of another config, data or code.
pub fn merge(
    experiment: &Experiment,
    folder: &Path,
    runs: &[PathBuf],
) -> Result<(RunFolder, Results)> {
    finish(experiment, folder, false, Some(&Merged::of(runs)?))
}

/// Does what neither the folder nor shards have; `merged` are those of other runs.
fn finish(
    experiment: &Experiment,
    folder: &Path,
    fresh: bool,
    merged: Option<&Merged>,
) -> Result<(RunFolder, Results)> {
    let (source, about) = data::open(&experiment.data)?;
    let source = source.as_ref();
    // Only an experiment that can be run changes the folder.
    let prepared = Prepared::new(experiment, source, &about)?;
    if let Some(merged) = merged {
        merged.ensure_ended(experiment, &provenance::data_hash(source, &about)?)?;
    }
    let folder = RunFolder::open(folder, fresh)?;
    if fresh {
        shards::forget(folder.path())?;
    }
    folder.write(folder::CONFIG, &experiment.resolved)?;
    let mut journals = Journals::open(folder.path())?;
    match merged {
        Some(merged) => {
            for path in merged.folders() {
                journals.adopt(Journals::look(path)?)?;
            }
        }
        None => shards::give(folder.path(), &mut journals)?,
    }
    let dealt = prepared.dealt(experiment.work)?;
    let rows = prepared.with_encoders(&dealt, |encoded| encoded.rows(&mut journals))?;
    let splits = &prepared.splits;
    let all = rows.iter().flat_map(|row| row.outcomes.values().flatten());
    let groups = splits.groups(source.surfaces());
    let (written, results) = rayon::join(
        || predictions::write(folder.path(), all, &groups),
        || results(experiment, source, &about, splits, &rows),
    );
    written?;
    let results = results?;
    results.write(folder.path())?;
    folder.seal(Vec::new())?;
    Ok((folder, results))
}

struct Journals {
    trials: Journal<Outcome>,
    selections: Journal<Found>,
}

impl Journals {
    /// Those in a folder, to write to.
    fn open(folder: &Path) -> Result<Self> {
        Ok(Self {
            trials: Journal::open(&folder.join(folder::TRIALS))?,
            selections: Journal::open(&folder.join(folder::SELECTIONS))?,
        })
    }

    /// Those in a folder, to look at alone.
    fn look(folder: &Path) -> Result<Self> {
        Ok(Self {
            trials: Journal::look(&folder.join(folder::TRIALS))?,
            selections: Journal::look(&folder.join(folder::SELECTIONS))?,
        })
    }

    /// Knows what others hold, too, without writing it down.
    fn know(&mut self, others: Self) {
        self.trials.know(others.trials);
        self.selections.know(others.selections);
    }

    fn adopt(&mut self, others: Self) -> Result<()> {
        self.trials.adopt(others.trials)?;
        self.selections.adopt(others.selections)
    }
}

/// The encoders of the methods in the order in which they come up, with the methods of each.
fn by_encoder(methods: &[Method]) -> Vec<(&EncoderSpec, Vec<usize>)> {
    let mut encoders: Vec<(&EncoderSpec, Vec<usize>)> = Vec::new();
    for (at, method) in methods.iter().enumerate() {
        let mut known = encoders.iter_mut();
        match known.find(|(spec, _)| **spec == method.encoder) {
            Some((_, members)) => members.push(at),
            None => encoders.push((&method.encoder, vec![at])),
        }
    }
    encoders
}
