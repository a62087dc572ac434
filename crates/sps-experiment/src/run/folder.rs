//! The folder of a run, which one process at a time writes to.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Result, ensure};
use tracing::warn;

use crate::checksums;
use crate::files::{
    create_folder, is_read_only, lock, remove, remove_unfinished, write_atomically,
};
use crate::predictions;

pub(crate) const TRIALS: &str = "trials.jsonl";
pub(crate) const SELECTIONS: &str = "selections.jsonl";
/// The config with its defaults and all that was set.
pub const CONFIG: &str = "config.toml";
/// What a run comes to, and reports are made from.
const RESULTS: [&str; 2] = ["results.json", predictions::FILE];
const LOCK: &str = "lock";

/// A locked folder; the lock goes with the process, however that ends.
pub struct RunFolder {
    path: PathBuf,
    /// None where it cannot be written to.
    _lock: Option<File>,
}

impl RunFolder {
    /// Opens or creates the folder, waiting for another run that is at work there. `fresh` forgets
    /// the trials that were finished in it.
    pub(crate) fn open(path: &Path, fresh: bool) -> Result<Self> {
        create_folder(path)?;
        let folder = Self::locked(path)?;
        for name in checksums::damaged(path)? {
            let path = folder.file(&name);
            warn!(
                "{}: the checksum does not match its content; it is written again",
                path.display()
            );
        }
        checksums::unseal(path)?;
        remove_unfinished(path, Duration::ZERO)?;
        if fresh {
            remove(&folder.file(TRIALS))?;
            remove(&folder.file(SELECTIONS))?;
        }
        Ok(folder)
    }

    /// Opens the folder of a finished run to look at it, waiting for a run that is at work there. One
    /// that cannot be written to is not locked.
    ///
    /// # Errors
    /// What is not the folder of a run; one in which none has finished, or whose files were changed.
    pub fn finished(path: &Path) -> Result<Self> {
        ensure!(
            path.join(CONFIG).exists(),
            "{} is not the folder of a run",
            path.display()
        );
        let folder = match Self::locked(path) {
            Err(error) if is_read_only(&error) => Self {
                path: path.to_owned(),
                _lock: None,
            },
            locked => locked?,
        };
        checksums::ensure_finished(path, &RESULTS)?;
        Ok(folder)
    }

    /// Locks the folder, waiting for another run that is at work there.
    pub(super) fn locked(path: &Path) -> Result<Self> {
        Ok(Self {
            path: path.to_owned(),
            _lock: Some(lock(&path.join(LOCK))?),
        })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A file in it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Writes the checksums of everything that a run has written, and of a report's files; journals
    /// have theirs in each line.
    ///
    /// # Errors
    /// A file that cannot be read; a folder that cannot be written to.
    pub fn seal(&self, report: Vec<String>) -> Result<()> {
        let own = [CONFIG].into_iter().chain(RESULTS).map(str::to_owned);
        checksums::seal(&self.path, &own.chain(report).collect::<Vec<_>>())
    }

    pub(crate) fn write(&self, name: &str, text: &str) -> Result<()> {
        write_atomically(&self.file(name), text.as_bytes())
    }
}
