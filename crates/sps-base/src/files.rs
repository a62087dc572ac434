//! Files and folders that are either there whole or not at all.
//!
//! What is being written has a hidden name of its own beside its place, so several threads and
//! processes may write to one folder, and the last one that finishes a file decides its content.
//!
//! ```
//! use std::time::Duration;
//!
//! use sps_base::files::{remove_unfinished, write_file};
//!
//! let folder = std::env::temp_dir().join("sps-base-files");
//! write_file(&folder.join("results.json"), b"{}")?;
//! remove_unfinished(&folder, Duration::ZERO)?; // what an earlier program left that was killed
//! # Ok::<(), std::io::Error>(())
//! ```

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

const UNFINISHED: &str = ".writing-";

/// Replaces or makes a file, with the permissions of any new file; its folder is made where there
/// is none. Whatever is killed or full, `path` has all of `bytes` or what it had before.
///
/// # Errors
/// Where the folder or file cannot be written; nothing new is left then.
pub fn write_file(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let (partial, file) = start(path, |partial| File::create_new(partial))?;
    let written = write_all(file, bytes).and_then(|()| fs::rename(&partial, path));
    if written.is_err() {
        // Best effort, to make room; what went wrong first is what is reported.
        let _ = fs::remove_file(&partial);
    }
    written.and_then(|()| sync(parent(path)))
}

/// Replaces or makes a folder of the files that `fill` writes into the one it is given, or leaves
/// none at all; `failed` makes the error of everything but `fill`.
///
/// # Errors
/// Where `fill` fails or the folder cannot be made, replaced or renamed.
pub fn write_folder<E>(
    path: &Path,
    fill: impl FnOnce(&Path) -> Result<(), E>,
    failed: impl Fn(io::Error) -> E,
) -> Result<(), E> {
    let (partial, ()) = start(path, |partial| fs::create_dir(partial)).map_err(&failed)?;
    let take_name = || {
        sync(&partial)?;
        remove_folder(path)?;
        fs::rename(&partial, path)?;
        sync(parent(path))
    };
    let written = fill(&partial).and_then(|()| take_name().map_err(&failed));
    if written.is_err() {
        // Best effort, as above.
        let _ = remove_folder(&partial);
    }
    written
}

/// Writes a file, as one of a folder that is not finished, and waits until it is on disk.
///
/// # Errors
/// Where it cannot be written.
pub fn write_new(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_all(File::create(path)?, bytes)
}

/// Removes what writers left in `folder` that were killed: what was not written to for at least so
/// long. None may be at work there that takes longer.
///
/// # Errors
/// Where the folder cannot be read, or something in it not removed.
pub fn remove_unfinished(folder: &Path, idle: Duration) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if !entry.file_name().to_string_lossy().starts_with(UNFINISHED) {
            continue;
        }
        let removed = entry.metadata().and_then(|metadata| {
            // A time to come is one of another machine's clock.
            if metadata.modified()?.elapsed().unwrap_or_default() < idle {
                Ok(())
            } else if metadata.is_dir() {
                fs::remove_dir_all(entry.path())
            } else {
                fs::remove_file(entry.path())
            }
        });
        match removed {
            // Finished, or removed by another.
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            removed => removed?,
        }
    }
    Ok(())
}

/// Creates what will be at `path` under a name that nothing has yet, on the same file system.
fn start<T>(path: &Path, create: impl Fn(&Path) -> io::Result<T>) -> io::Result<(PathBuf, T)> {
    if path.file_name().is_none() {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    fs::create_dir_all(parent(path))?;
    for attempt in 0..u32::MAX {
        let name = format!("{UNFINISHED}{}-{attempt}", std::process::id());
        let partial = path.with_file_name(name);
        match create(&partial) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            created => return Ok((partial, created?)),
        }
    }
    Err(io::ErrorKind::AlreadyExists.into())
}

fn write_all(mut file: File, bytes: &[u8]) -> io::Result<()> {
    file.write_all(bytes)?;
    file.sync_all()
}

fn remove_folder(path: &Path) -> io::Result<()> {
    match fs::remove_dir_all(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

fn parent(path: &Path) -> &Path {
    path.parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

/// A name is on disk once its folder is; only Unix lets a folder be opened for that.
fn sync(folder: &Path) -> io::Result<()> {
    if cfg!(unix) {
        File::open(folder)?.sync_all()
    } else {
        Ok(())
    }
}
