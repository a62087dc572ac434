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
mod selection;
mod shards;
mod splits;
mod stage;
mod tables;
mod test_views;
mod trials;
pub(crate) mod views;

use std::path::{Path, PathBuf};

use anyhow::Result;
use sps_dataset::Source;

pub(crate) use deal::Dealt;
pub(crate) use encodings::Encodings;
pub(crate) use estimates::Estimates;
pub use folder::{CONFIG, RunFolder};
pub(crate) use found::Selections;
pub(crate) use frozen::Folds;
pub(crate) use held_out::{portion, what_is_measured};
pub use outlook::outlook;
pub(crate) use select::Selecting;
pub use shards::run as shard;
pub(crate) use splits::Splits;
pub(crate) use stage::{Stage, Stages};
pub(crate) use tables::Tables;

use crate::config::{EncoderSpec, Experiment, Method};
use crate::data::{self, About, WithSource};
use crate::journal::{Journal, Outcome};
use crate::predictions;
use crate::results::Results;
use encoded::Encoded;
use found::Found;
use prepared::{Prepared, WithEncoder};
use results::{MethodRow, results};
use shards::Merged;

/// Runs the experiment into `folder`, or finishes what was begun there, in shards or not; `fresh`
/// begins again. The folder stays locked: a report of the results may follow.
///
/// # Errors
/// Data or weights that cannot be read, methods that do not fit the data, a folder that cannot be written to.
pub fn run(experiment: &Experiment, folder: &Path, fresh: bool) -> Result<(RunFolder, Results)> {
    let work = Run {
        experiment,
        folder,
        fresh,
        merged: None,
    };
    work.finish()
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
    let work = Run {
        experiment,
        folder,
        fresh: false,
        merged: Some(Merged::of(experiment, runs)?),
    };
    work.finish()
}

struct Run<'a> {
    experiment: &'a Experiment,
    folder: &'a Path,
    fresh: bool,
    /// Shards in which it was done.
    merged: Option<Merged>,
}

impl Run<'_> {
    fn finish(self) -> Result<(RunFolder, Results)> {
        let (folder, results) = data::with_source(&self.experiment.data, self)?;
        results.write(folder.path())?;
        folder.seal(Vec::new())?;
        Ok((folder, results))
    }

    /// The folder, to write to; only an experiment that can be run gets so far.
    fn open(&self) -> Result<RunFolder> {
        let folder = RunFolder::open(self.folder, self.fresh)?;
        if self.fresh {
            shards::forget(folder.path())?;
        }
        folder.write(folder::CONFIG, &self.experiment.resolved)?;
        Ok(folder)
    }

    /// What others have done of it, too.
    fn gather<S: Source>(&self, source: &S, about: &About, folder: &RunFolder) -> Result<Journals> {
        let mut journals = Journals::open(folder.path())?;
        match &self.merged {
            Some(merged) => {
                merged.ensure_data(&provenance::data_hash(source, about)?)?;
                merged.give(&mut journals)?;
            }
            None => shards::give(folder.path(), &mut journals)?,
        }
        Ok(journals)
    }
}

impl WithSource for Run<'_> {
    type Output = (RunFolder, Results);

    fn call<S: Source>(self, source: &S, about: About) -> Result<Self::Output> {
        let experiment = self.experiment;
        let prepared = Prepared::new(experiment, source, &about)?;
        let folder = self.open()?;
        let mut journals = self.gather(source, &about, &folder)?;
        let dealt = prepared.dealt()?;
        let done = prepared.with_encoders(source, &dealt, Rows(&mut journals))?;
        let (mut rows, mut properties) = (Vec::new(), Vec::new());
        for (members, (codes, of_encoder)) in done {
            rows.extend(members.into_iter().zip(of_encoder));
            properties = codes;
        }
        rows.sort_by_key(|(at, _)| *at);
        let rows: Vec<MethodRow<'_>> = rows.into_iter().map(|(_, row)| row).collect();
        let splits = &prepared.splits;
        let all = rows.iter().flat_map(|row| row.outcomes.values().flatten());
        let estimates = predictions::of_outcomes(all, &splits.groups(source.surfaces()));
        predictions::write(folder.path(), &estimates)?;
        let results = results(experiment, source, &about, properties, splits, &rows)?;
        Ok((folder, results))
    }
}

/// Runs what the journals lack and measures what estimates cost: the rows of the methods.
struct Rows<'a>(&'a mut Journals);

impl<'m> WithEncoder<'m> for Rows<'_> {
    type Output = (Vec<String>, Vec<MethodRow<'m>>);

    fn call<S: Source>(
        &mut self,
        encoded: &Encoded<'_, 'm>,
        source: &S,
        sequence: Option<Vec<usize>>,
    ) -> Result<Self::Output> {
        encoded.rows(source, sequence, self.0)
    }
}

/// What a run has written down.
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

    /// Adds what others hold.
    fn adopt(&mut self, others: Self) -> Result<()> {
        self.trials.adopt(others.trials)?;
        self.selections.adopt(others.selections)
    }
}

/// The encoders of the methods in the order in which they come up, with the methods of each.
fn by_encoder(methods: &[Method]) -> Vec<(&EncoderSpec, Vec<usize>)> {
    let mut encoders: Vec<(&EncoderSpec, Vec<usize>)> = Vec::new();
    for (at, method) in methods.iter().enumerate() {
        match encoders
            .iter_mut()
            .find(|(spec, _)| **spec == method.encoder)
        {
            Some((_, members)) => members.push(at),
            None => encoders.push((&method.encoder, vec![at])),
        }
    }
    encoders
}
