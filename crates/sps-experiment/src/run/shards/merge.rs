//! Shards that together are all of an experiment.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};

use super::manifest::Manifest;
use super::{OfShard, folders};
use crate::config::Experiment;
use crate::run::Journals;
use crate::run::folder::RunFolder;
use crate::work::Shard;

/// All shards of an experiment, ended and alike.
pub(in crate::run) struct Merged {
    /// Of the runs that they are below.
    runs: Vec<PathBuf>,
    shards: Vec<(OfShard, Manifest)>,
}

impl Merged {
    /// Those below the folders of some runs, waiting for shards that are at work.
    ///
    /// # Errors
    ///
    /// A shard that is missing, has not ended, or is of another experiment.
    pub(in crate::run) fn of(experiment: &Experiment, runs: &[PathBuf]) -> Result<Self> {
        let mut found = Vec::new();
        for run in runs {
            let below = folders(run)?;
            ensure!(
                !below.is_empty(),
                "--merge {}: no shards here; `--shard K/N --out {0}` makes them",
                run.display()
            );
            found.extend(below);
        }
        ensure_complete(&found)?;
        let read = found.into_iter().map(|one| {
            let manifest = ended(&one)?;
            ensure_same(&one, manifest.other_than(experiment)?)?;
            Ok((one, manifest))
        });
        Ok(Self {
            shards: read.collect::<Result<_>>()?,
            runs: runs.to_vec(),
        })
    }

    /// That all of them looked at this data.
    pub(in crate::run) fn ensure_data(&self, data_hash: &blake3::Hash) -> Result<()> {
        let mut shards = self.shards.iter();
        shards.try_for_each(|(one, manifest)| ensure_same(one, manifest.other_data(data_hash)))
    }

    /// Adds what they have done, and what the runs had done before them.
    pub(in crate::run) fn give(&self, journals: &mut Journals) -> Result<()> {
        let shards = self.shards.iter().map(|(one, _)| &one.path);
        for path in self.runs.iter().chain(shards) {
            journals.adopt(Journals::look(path)?)?;
        }
        Ok(())
    }
}

/// That there is each of as many as they say, once or more.
fn ensure_complete(found: &[OfShard]) -> Result<()> {
    let Some(first) = found.first() else {
        return Ok(());
    };
    for one in found {
        ensure!(
            one.shard.of == first.shard.of,
            "{} and {} do not belong together: shards of one experiment are of one number",
            named(first),
            named(one)
        );
    }
    let is_missing = |shard: &Shard| found.iter().all(|one| one.shard != *shard);
    let missing = Shard::all(first.shard.of).filter(is_missing);
    let missing: Vec<String> = missing.map(|shard| shard.to_string()).collect();
    ensure!(
        missing.is_empty(),
        "--merge: shards are missing: {}; `--shard` with each makes it",
        missing.join(", ")
    );
    Ok(())
}

/// The manifest of a shard that has ended; one that is at work is waited for.
fn ended(one: &OfShard) -> Result<Manifest> {
    let _lock = RunFolder::locked(&one.path)?;
    let manifest = Manifest::read(&one.path)?;
    let manifest = manifest.filter(|manifest| manifest.ended);
    manifest.with_context(|| {
        let shard = one.shard;
        format!(
            "{} has not ended; `--shard {shard}` again goes on where it was stopped",
            named(one)
        )
    })
}

fn ensure_same(one: &OfShard, other: Option<String>) -> Result<()> {
    match other {
        None => Ok(()),
        Some(other) => bail!("{} is of {other}", named(one)),
    }
}

fn named(one: &OfShard) -> String {
    format!("shard {} in {}", one.shard, one.path.display())
}
