//! The folder of a run, which one process at a time writes to.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use tracing::info;

use crate::files::{create_folder, write_atomically};

/// The journal of finished trials.
pub(crate) const TRIALS: &str = "trials.jsonl";
/// The journal of selected views.
pub(crate) const SELECTIONS: &str = "selections.jsonl";

/// A locked folder; the lock goes with the process, however that ends.
pub(crate) struct RunFolder {
    path: PathBuf,
    _lock: File,
}

impl RunFolder {
    /// Opens or creates the folder, waiting for another run that is at work there. `fresh` forgets
    /// the trials that were finished in it.
    pub(crate) fn open(path: &Path, fresh: bool) -> Result<Self> {
        create_folder(path)?;
        let lock = lock(&path.join("lock"))?;
        let folder = Self {
            path: path.to_owned(),
            _lock: lock,
        };
        for journal in [TRIALS, SELECTIONS].map(|name| folder.file(name)) {
            if fresh && journal.exists() {
                std::fs::remove_file(&journal)
                    .with_context(|| format!("cannot remove {}", journal.display()))?;
            }
        }
        Ok(folder)
    }

    /// The folder.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// A file in it.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Writes a text file into it.
    pub(crate) fn write(&self, name: &str, text: &str) -> Result<()> {
        write_atomically(&self.file(name), text.as_bytes())
    }
}

fn lock(path: &Path) -> Result<File> {
    let failed = || format!("cannot lock {}", path.display());
    let file = OpenOptions::new()
        .create(true)
        .append(true)
        .open(path)
        .with_context(failed)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            info!("another run is at work in this folder; waiting for it to end");
            file.lock().with_context(failed)?;
        }
        Err(TryLockError::Error(error)) => return Err(error).with_context(failed),
    }
    Ok(file)
}
