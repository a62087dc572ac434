//! Shards: parts of an experiment that other processes do, each in a folder of its own below that of
//! a run, `shards/2-of-4`, with a journal and a manifest.

mod manifest;
mod merge;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::folder::RunFolder;
use super::prepared::Prepared;
use super::{Journals, provenance};
use crate::config::Experiment;
use crate::data;
use crate::files::inside;
use crate::work::Shard;
use manifest::Manifest;
pub(super) use merge::Merged;

const SHARDS: &str = "shards";

/// A shard that has begun.
pub(super) struct OfShard {
    pub shard: Shard,
    pub path: PathBuf,
}

/// The shards below the folder of a run, in their order.
pub(super) fn folders(run: &Path) -> Result<Vec<OfShard>> {
    let found = inside(&run.join(SHARDS))?.into_iter().filter_map(|path| {
        let shard = Shard::of_folder(&path.file_name()?.to_string_lossy())?;
        Some(OfShard { shard, path })
    });
    let mut found: Vec<OfShard> = found.collect();
    found.sort_by_key(|one| one.shard);
    Ok(found)
}

/// Adds what the shards of a run have done, waiting for those that are at work.
pub(super) fn give(run: &Path, journals: &mut Journals) -> Result<()> {
    for OfShard { path, .. } in folders(run)? {
        let _lock = RunFolder::locked(&path)?;
        journals.adopt(Journals::look(&path)?)?;
    }
    Ok(())
}

/// Forgets the shards of a run, waiting for those that are at work.
pub(super) fn forget(run: &Path) -> Result<()> {
    for OfShard { path, .. } in folders(run)? {
        let _lock = RunFolder::locked(&path)?;
        let removed = fs::remove_dir_all(&path);
        removed.with_context(|| format!("cannot remove {}", path.display()))?;
    }
    Ok(())
}

/// Does what is missing of a shard of the experiment, whose run is in `folder`; `fresh` begins again.
/// The shard's own folder.
///
/// # Errors
/// As those of [`run`](fn@super::run).
pub fn run(experiment: &Experiment, shard: Shard, folder: &Path, fresh: bool) -> Result<PathBuf> {
    let path = folder.join(SHARDS).join(shard.folder());
    let (source, about) = data::open(&experiment.data)?;
    let prepared = Prepared::new(experiment, source.as_ref(), &about)?;
    let _locked = RunFolder::open(&path, fresh)?;
    let data_hash = provenance::data_hash(source.as_ref(), &about)?;
    let mut manifest = Manifest::new(experiment, shard, &data_hash);
    manifest.write(&path)?;
    let mut journals = Journals::open(&path)?;
    if !fresh {
        // What the run itself has done.
        journals.know(Journals::look(folder)?);
    }
    let dealt = prepared.dealt(experiment.work)?;
    prepared.with_encoders(&dealt, |encoded| {
        encoded.fitted(&mut journals)?;
        // All that comes of it stands in the journals.
        Ok(Vec::<()>::new())
    })?;
    manifest.ended = true;
    manifest.write(&path)?;
    Ok(path)
}
