//! Writing files so that a reader never sees half of one.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Error, Result};
use sps_base::files::write_file;
use tracing::info;

/// Writes `bytes` to `path` in one step: whatever is killed or full, `path` holds the whole new
/// content or what it held before.
///
/// # Errors
/// A folder that cannot be written to, or is full.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    write_file(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// Removes what writers left in `folder` that were killed: what was not written to for at least so long.
pub(crate) fn remove_unfinished(folder: &Path, idle: Duration) -> Result<()> {
    sps_base::files::remove_unfinished(folder, idle)
        .with_context(|| format!("cannot remove unfinished files from {}", folder.display()))
}

/// Creates a folder and its parents.
///
/// # Errors
/// A place that cannot be written to.
pub fn create_folder(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))
}

/// Locks the folder of the file at `path`, waiting for another process that is at work there. The
/// lock goes with the value, and with the process, however that ends.
pub(crate) fn lock(path: &Path) -> Result<File> {
    let failed = || format!("cannot lock {}", path.display());
    let file = OpenOptions::new()
        .create(true)
        .append(true)
        .open(path)
        .with_context(failed)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            info!(
                "{}: another run is at work in this folder; waiting for it to end",
                path.display()
            );
            file.lock().with_context(failed)?;
        }
        Err(TryLockError::Error(error)) => return Err(error).with_context(failed),
    }
    Ok(file)
}

/// Whether something was not written because its folder may not be written to.
pub fn is_read_only(error: &Error) -> bool {
    let error = error.root_cause().downcast_ref().map(io::Error::kind);
    matches!(
        error,
        Some(ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem)
    )
}

pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}

/// Removes a file where there is one.
pub(crate) fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", path.display()))
        }
        _ => Ok(()),
    }
}

/// What is in a folder, in the order of names; nothing where there is no such folder.
pub(crate) fn inside(folder: &Path) -> Result<Vec<PathBuf>> {
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let paths =
        fs::read_dir(folder).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    let mut paths: Vec<PathBuf> =
        paths.with_context(|| format!("cannot read {}", folder.display()))?;
    paths.sort();
    Ok(paths)
}

/// Reads a text file.
///
/// # Errors
/// A file that cannot be read, or is no UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_the_file_that_cannot_be_written() {
        let folder = tempfile::tempdir().unwrap();
        let blocked = folder.path().join("file");
        fs::write(&blocked, b"").unwrap();
        let error = write_atomically(&blocked.join("a.json"), b"x").unwrap_err();
        assert!(format!("{error:#}").contains("file"), "{error:#}");
    }
}
