//! Checksums of stored files, so that a damaged one is found before it is believed.
//!
//! Files that are read again have theirs beside them, as `NAME.blake3`. The files of a finished run
//! have theirs together in `checksums`, which `b3sum --check` reads too.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use tracing::warn;

use crate::files::{self, write_atomically};

const FOLDER: &str = "checksums";

fn of(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

fn beside(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".blake3");
    path.with_file_name(name)
}

/// Writes `bytes` to `path` with its checksum beside it. Whenever it is killed, one of the two
/// checksums that are kept is that of the file.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let before = fs::read(path).ok().filter(|bytes| is_kept(path, bytes));
    let before = before.map(|bytes| of(&bytes)).unwrap_or_default();
    let both = format!("{before}\n{}\n", of(bytes));
    write_atomically(&beside(path), both.as_bytes())?;
    write_atomically(path, bytes)
}

/// Whether one of the checksums beside `path` is that of `bytes`.
fn is_kept(path: &Path, bytes: &[u8]) -> bool {
    let kept = fs::read(beside(path)).unwrap_or_default();
    let mut kept = kept.split(|byte| *byte == b'\n');
    let checksum = of(bytes);
    kept.any(|kept| kept == checksum.as_bytes())
}

/// Reads what [`write()`] wrote: nothing where there is no such file or, with a line in the log,
/// where it is damaged.
pub(crate) fn read(path: &Path) -> Result<Option<Vec<u8>>> {
    if !path.exists() {
        return Ok(None);
    }
    let bytes = files::read(path)?;
    if is_kept(path, &bytes) {
        return Ok(Some(bytes));
    }
    warn!(
        "{}: the checksum does not match its content; it is made again",
        path.display()
    );
    Ok(None)
}

pub(crate) fn remove(path: &Path) -> Result<()> {
    files::remove(path)?;
    files::remove(&beside(path))
}

/// Writes the checksums of these files of a folder, with `/` between the parts of their names.
///
/// # Errors
/// A file that cannot be read; a folder that cannot be written to.
pub fn seal(folder: &Path, names: &[String]) -> Result<()> {
    let lines = names.iter().map(|name| {
        let bytes = files::read(&folder.join(name))?;
        Ok(format!("{}  {name}\n", of(&bytes)))
    });
    let text = lines.collect::<Result<String>>()?;
    write_atomically(&folder.join(FOLDER), text.as_bytes())
}

/// Forgets the checksums of a folder whose files are about to change.
pub(crate) fn unseal(folder: &Path) -> Result<()> {
    files::remove(&folder.join(FOLDER))
}

/// The files of a sealed folder that are no longer what they were, and `checksums` itself where a
/// line of it cannot be read; none where the folder is not sealed.
pub(crate) fn damaged(folder: &Path) -> Result<Vec<String>> {
    let path = folder.join(FOLDER);
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text = files::read(&path)?;
    let text = String::from_utf8_lossy(&text);
    let lines = text.split('\n').filter(|line| !line.is_empty());
    let damaged = lines.filter_map(|line| {
        let Some((checksum, name)) = line.split_once("  ") else {
            return Some(FOLDER.to_owned());
        };
        let same = fs::read(folder.join(name)).is_ok_and(|bytes| of(&bytes) == checksum);
        (!same).then(|| name.to_owned())
    });
    Ok(damaged.collect())
}

/// That the run in `folder` has ended, and that the files `names` are what it wrote.
///
/// # Errors
/// A folder in which no run has finished; a file that was changed since.
pub fn ensure_finished(folder: &Path, names: &[&str]) -> Result<()> {
    const AGAIN: &str = "`experiment` writes it again";
    let shown = folder.display();
    ensure!(
        folder.join(FOLDER).exists(),
        "{shown}: no run has finished here since the last one began; {AGAIN}"
    );
    let damaged = damaged(folder)?;
    if let Some(file) = damaged.iter().find(|name| names.contains(&&name[..])) {
        bail!("{shown}/{file}: the checksum does not match its content; {AGAIN}");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flipped_bit_is_found_wherever_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        assert_eq!(read(&path).unwrap(), None);
        write(&path, b"one").unwrap();
        assert_eq!(read(&path).unwrap().unwrap(), b"one");
        for file in [path.clone(), beside(&path)] {
            let whole = fs::read(&file).unwrap();
            for at in 0..whole.len() {
                let mut bytes = whole.clone();
                bytes[at] ^= 4;
                fs::write(&file, &bytes).unwrap();
                assert_eq!(read(&path).unwrap(), None, "{at}");
            }
            fs::write(&file, &whole).unwrap();
        }
        remove(&path).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    /// Killed between the checksum and the file, twice.
    #[test]
    fn what_was_there_before_is_still_believed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        write(&path, b"one").unwrap();
        for next in ["two", "three"] {
            write(&path, next.as_bytes()).unwrap();
            fs::write(&path, b"one").unwrap();
            assert_eq!(read(&path).unwrap().unwrap(), b"one", "{next}");
        }
        fs::write(&path, b"two").unwrap();
        assert_eq!(read(&path).unwrap(), None);
    }

    #[test]
    fn a_sealed_folder_knows_what_changed() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        assert!(damaged(folder).unwrap().is_empty());
        fs::create_dir(folder.join("figures")).unwrap();
        let names = ["results.json", "figures/a b.svg"].map(str::to_owned);
        for name in &names {
            fs::write(folder.join(name), name).unwrap();
        }
        assert!(ensure_finished(folder, &[]).is_err());
        seal(folder, &names).unwrap();
        fs::write(folder.join("lock"), "other").unwrap();
        assert!(damaged(folder).unwrap().is_empty());
        fs::write(folder.join("figures/a b.svg"), "other").unwrap();
        assert_eq!(damaged(folder).unwrap(), ["figures/a b.svg"]);
        ensure_finished(folder, &["results.json"]).unwrap();
        assert!(ensure_finished(folder, &["figures/a b.svg"]).is_err());
        fs::remove_file(folder.join("results.json")).unwrap();
        assert_eq!(damaged(folder).unwrap().len(), 2);
        unseal(folder).unwrap();
        assert!(damaged(folder).unwrap().is_empty());
    }
}
