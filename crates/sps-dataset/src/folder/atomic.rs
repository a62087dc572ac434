//! Files and folders that are either there whole or not at all.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Replaces or makes a file: the new content is on disk before it takes the name.
pub(super) fn write_file(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let partial = partial(path)?;
    let written = write_new(&partial, bytes).and_then(|()| fs::rename(&partial, path));
    if written.is_err() {
        // Best effort, to make room; what went wrong first is what is reported.
        let _ = fs::remove_file(&partial);
    }
    written.and_then(|()| sync_parent(path))
}

/// Makes a folder of the files that `fill` writes, or none at all; `failed` makes the error of
/// everything but `fill`.
pub(super) fn write_folder<E>(
    path: &Path,
    fill: impl FnOnce(&Path) -> Result<(), E>,
    failed: impl Fn(io::Error) -> E,
) -> Result<(), E> {
    let partial = partial(path).map_err(&failed)?;
    let make = || remove_folder(&partial).and_then(|()| fs::create_dir_all(&partial));
    let take_name = || {
        sync(&partial)?;
        remove_folder(path)?;
        fs::rename(&partial, path)?;
        sync_parent(path)
    };
    let written = make()
        .map_err(&failed)
        .and_then(|()| fill(&partial))
        .and_then(|()| take_name().map_err(&failed));
    if written.is_err() {
        // Best effort, to make room; what went wrong first is what is reported.
        let _ = remove_folder(&partial);
    }
    written
}

/// Writes a file and waits until it is on disk.
pub(super) fn write_new(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Where it is until it is finished: a hidden name beside it, on the same file system.
fn partial(path: &Path) -> io::Result<PathBuf> {
    let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
    let mut hidden = OsString::from(".");
    hidden.push(name);
    hidden.push(".partial");
    Ok(path.with_file_name(hidden))
}

fn remove_folder(path: &Path) -> io::Result<()> {
    match fs::remove_dir_all(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

fn sync_parent(path: &Path) -> io::Result<()> {
    path.parent().map_or(Ok(()), sync)
}

/// A name is on disk once its folder is; only Unix lets a folder be opened for that.
fn sync(folder: &Path) -> io::Result<()> {
    if cfg!(unix) {
        File::open(folder)?.sync_all()
    } else {
        Ok(())
    }
}
