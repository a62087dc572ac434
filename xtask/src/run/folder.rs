//! The folder of a run, which one process at a time writes to.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use tracing::warn;

use crate::checksums;
use crate::files::{create_folder, lock, remove_unfinished, write_atomically};

/// The journal of finished trials.
pub(crate) const TRIALS: &str = "trials.jsonl";
/// The journal of selected views.
pub(crate) const SELECTIONS: &str = "selections.jsonl";
const LOCK: &str = "lock";

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
        let lock = lock(&path.join(LOCK))?;
        let folder = Self {
            path: path.to_owned(),
            _lock: lock,
        };
        for name in checksums::damaged(path)? {
            let path = folder.file(&name);
            warn!(
                "{}: the checksum does not match its content; it is written again",
                path.display()
            );
        }
        checksums::unseal(path)?;
        remove_unfinished(path)?;
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

    /// Notes the checksums of everything that is finished; journals have theirs in each line.
    pub(crate) fn seal(&self) -> Result<()> {
        seal(&self.path)
    }

    /// Writes a text file into it.
    pub(crate) fn write(&self, name: &str, text: &str) -> Result<()> {
        write_atomically(&self.file(name), text.as_bytes())
    }
}

/// Notes the checksums of everything that is finished in the folder of a run.
pub(crate) fn seal(path: &Path) -> Result<()> {
    checksums::seal(path, &[LOCK, TRIALS, SELECTIONS])
}
