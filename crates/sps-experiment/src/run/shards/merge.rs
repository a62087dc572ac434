//! Shards that together are all of an experiment.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};

use super::manifest::Manifest;
use super::{OfShard, folders};
use crate::config::Experiment;
use crate::run::folder::RunFolder;
use crate::work::Shard;

/// All shards of an experiment, and the runs that they are below.
pub(in crate::run) struct Merged {
    runs: Vec<PathBuf>,
    shards: Vec<OfShard>,
}

impl Merged {
    /// Those below some runs.
    pub(in crate::run) fn of(runs: &[PathBuf]) -> Result<Self> {
        let mut shards = Vec::new();
        for run in runs {
            let below = folders(run)?;
            ensure!(
                !below.is_empty(),
                "--merge {}: no shards here; `--shard K/N --out {0}` makes them",
                run.display()
            );
            shards.extend(below);
        }
        ensure_complete(&shards)?;
        Ok(Self {
            runs: runs.to_vec(),
            shards,
        })
    }

    /// That they have ended, and are of this experiment, on this data; shards that are at work are waited for.
    pub(in crate::run) fn ensure_ended(
        &self,
        experiment: &Experiment,
        data_hash: &blake3::Hash,
    ) -> Result<()> {
        for one in &self.shards {
            if let Some(other) = ended(one)?.other_than(experiment, data_hash)? {
                bail!("{} is of {other}", named(one));
            }
        }
        Ok(())
    }

    /// The folders of the runs and of the shards.
    pub(in crate::run) fn folders(&self) -> impl Iterator<Item = &PathBuf> {
        let shards = self.shards.iter().map(|one| &one.path);
        self.runs.iter().chain(shards)
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

fn named(one: &OfShard) -> String {
    format!("shard {} in {}", one.shard, one.path.display())
}
