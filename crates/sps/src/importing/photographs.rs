//! Photographs in a folder.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use sps_dataset::{PHOTOGRAPH_ENDINGS, photograph_ending};

/// A folder outside of which no photograph is taken: a path is judged by what it leads to, symbolic links followed.
pub(super) struct Folder {
    /// As it was named, for messages.
    named: PathBuf,
    real: PathBuf,
    /// The folders of the views, or the folder itself.
    views: Vec<PathBuf>,
}

/// A file to be copied.
pub(super) struct Photograph {
    pub(super) path: PathBuf,
    /// What its name ends in, in small letters.
    pub(super) ending: &'static str,
}

impl Photograph {
    /// The one at this path.
    pub(super) fn of(path: &Path) -> Result<Self> {
        let ending = photograph_ending(path).with_context(|| {
            let endings = PHOTOGRAPH_ENDINGS.join(", ");
            format!("{}: expected a file that ends in {endings}", path.display())
        })?;
        let path = fs::canonicalize(path).with_context(|| path.display().to_string())?;
        Ok(Self { path, ending })
    }
}

impl Folder {
    /// The folder, with its photographs in folders by view where there are `views`.
    pub(super) fn open(named: &Path, views: &[String]) -> Result<Self> {
        let real = fs::canonicalize(named).with_context(|| named.display().to_string())?;
        let mut folder = Self {
            named: named.to_owned(),
            views: vec![real.clone()],
            real,
        };
        if !views.is_empty() {
            let views = views.iter().map(|view| folder.inside(&folder.real, view));
            folder.views = views.collect::<Result<_>>()?;
        }
        Ok(folder)
    }

    /// What a path leads to, if it is in the folder.
    fn inside(&self, from: &Path, path: &str) -> Result<PathBuf> {
        let whole = from.join(path);
        let below = whole.strip_prefix(&self.real).unwrap_or(&whole);
        let (written, named) = (below.to_string_lossy(), self.named.display());
        let written = written.escape_debug();
        let real = fs::canonicalize(&whole)
            .with_context(|| format!("there is no `{written}` in {named}"))?;
        ensure!(
            real.starts_with(&self.real),
            "`{written}` lies outside of {named}: copy it there"
        );
        Ok(real)
    }

    /// The photograph that a path names, in the folder of each view.
    pub(super) fn photographs(&self, path: &str) -> Result<Vec<Photograph>> {
        let expected = || {
            let (found, endings) = (path.escape_debug(), PHOTOGRAPH_ENDINGS.join(", "));
            format!("found `{found}`, expected a file that ends in {endings}")
        };
        let ending = photograph_ending(Path::new(path)).with_context(expected)?;
        let of_view = |view: &PathBuf| {
            let path = self.inside(view, path)?;
            ensure!(path.is_file(), expected());
            Ok(Photograph { path, ending })
        };
        self.views.iter().map(of_view).collect()
    }

    /// The names of the parts of a photograph's path in the folder, without its ending.
    pub(super) fn parts(&self, path: &str) -> Result<Vec<String>> {
        let written = Path::new(path);
        let up = |part: Component| part == Component::ParentDir;
        let relative = if written.is_absolute() || written.components().any(up) {
            let real = self.inside(&self.views[0], path)?;
            let below = real.strip_prefix(&self.views[0]);
            below.or_else(|_| real.strip_prefix(&self.real))?.to_owned()
        } else {
            written.to_owned()
        };
        let relative = relative.with_extension("");
        let names = relative.components().filter_map(|part| match part {
            Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
            _ => None,
        });
        Ok(names.collect())
    }

    /// The names of the photographs in a folder below that of each view.
    pub(super) fn names(&self, below: &str) -> Result<BTreeSet<String>> {
        let mut names = BTreeSet::new();
        for view in &self.views {
            let folder = self.inside(view, below)?;
            let entries = fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
            for entry in entries {
                let entry = entry?;
                if is_photograph(&entry.path()) {
                    names.insert(entry.file_name().to_string_lossy().into_owned());
                }
            }
        }
        refuse_empty(&self.named.join(below), names.is_empty())?;
        Ok(names)
    }

    /// The photographs in the folder, at any depth, that are not among `used`.
    pub(super) fn others(&self, used: &BTreeSet<&Path>) -> Result<Vec<PathBuf>> {
        let (mut others, mut folders) = (Vec::new(), vec![self.real.clone()]);
        while let Some(folder) = folders.pop() {
            let entries = fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
            for entry in entries {
                let entry = entry?;
                let path = entry.path();
                // Not by `is_dir`, which would follow links, perhaps for ever.
                if entry.file_type()?.is_dir() {
                    folders.extend(Some(path).filter(|path| !is_hidden(path)));
                } else if is_photograph(&path) && !used.contains(&*fs::canonicalize(&path)?) {
                    others.push(path.strip_prefix(&self.real)?.to_owned());
                }
            }
        }
        others.sort();
        Ok(others)
    }
}

/// Refuses a folder in which no photograph was found.
pub(super) fn refuse_empty(folder: &Path, is_empty: bool) -> Result<()> {
    let (folder, endings) = (folder.display(), PHOTOGRAPH_ENDINGS.join(", "));
    ensure!(
        !is_empty,
        "{folder} has no photograph, expected files that end in {endings}"
    );
    Ok(())
}

/// Photographs by their names, where it is plain which order that is.
pub(super) fn in_order(names: BTreeSet<String>) -> Result<Vec<String>> {
    let names: Vec<String> = names.into_iter().collect();
    let mut pairs = names.windows(2);
    let unclear = pairs.find(|pair| by_numbers(&pair[0]) > by_numbers(&pair[1]));
    if let Some([first, second]) = unclear {
        let (first, second) = (first.escape_debug(), second.escape_debug());
        bail!(
            "by letters `{first}` comes before `{second}`, by numbers after it: write the numbers with equally many \
             digits"
        );
    }
    Ok(names)
}

/// A name whose order by letters is that by numbers: each number has twenty digits.
fn by_numbers(name: &str) -> String {
    let letters: Vec<char> = name.chars().collect();
    let parts = letters.chunk_by(|one, next| one.is_ascii_digit() == next.is_ascii_digit());
    let padded = parts.map(|part| {
        let text: String = part.iter().collect();
        if part[0].is_ascii_digit() {
            format!("{text:0>20}")
        } else {
            text
        }
    });
    padded.collect()
}

fn is_photograph(path: &Path) -> bool {
    !is_hidden(path) && photograph_ending(path).is_some() && path.is_file()
}

/// Some systems put hidden files of their own beside photographs.
fn is_hidden(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().starts_with('.')
}
