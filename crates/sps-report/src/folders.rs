//! The folders of a report in that of a run: a file for each figure, two for each table.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use sps_experiment::files::write_atomically;

pub(super) struct Folder {
    name: &'static str,
    endings: &'static [&'static str],
}

pub(super) const FIGURES: Folder = Folder {
    name: "figures",
    endings: &["svg"],
};

pub(super) const TABLES: Folder = Folder {
    name: "tables",
    endings: &["csv", "tex"],
};

impl Folder {
    /// Writes contents by the names of their files, and removes what an earlier report left. The files, in the
    /// order of their names.
    pub(super) fn write(
        &self,
        run: &Path,
        contents: &BTreeMap<String, Vec<u8>>,
    ) -> Result<impl Iterator<Item = String>> {
        for (name, content) in contents {
            write_atomically(&run.join(self.name).join(name), content)?;
        }
        for path in self.paths(run)? {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if !contents.contains_key(name.as_ref()) {
                fs::remove_file(&path)
                    .with_context(|| format!("cannot remove {}", path.display()))?;
            }
        }
        let names = contents.keys();
        Ok(names.map(|name| format!("{}/{name}", self.name)))
    }

    /// The files of a finished run, in the order of their names.
    pub(super) fn paths(&self, run: &Path) -> Result<Vec<PathBuf>> {
        let folder = run.join(self.name);
        let failed = || format!("cannot read {}", folder.display());
        let entries = fs::read_dir(&folder).with_context(failed)?;
        let entries = entries.map(|entry| Ok(entry.with_context(failed)?.path()));
        let mut paths: Vec<PathBuf> = entries.collect::<Result<_>>()?;
        let has = |path: &PathBuf, ending| path.extension().is_some_and(|found| found == ending);
        paths.retain(|path| self.endings.iter().any(|ending| has(path, *ending)));
        paths.sort();
        Ok(paths)
    }
}
