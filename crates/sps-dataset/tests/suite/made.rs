//! Datasets made for one test.
#![allow(dead_code, reason = "each test file uses some of it")]

use std::path::Path;

use sps_dataset::{DatasetError, DatasetFolder, Property, RangePolicy, ReadSettings};
use tempfile::TempDir;

/// Three surfaces, one view, two properties.
pub(crate) const MANIFEST: &str = "\
name = \"made\"
properties = [\"fRS\", \"cDF\"]
view-angles-deg = [0.0]
";

pub(crate) const SURFACES: &str = "surface,material,group\na,wood,a\nb,wood,b\nc,denim,c\n";

pub(crate) fn property(code: &str) -> Property {
    code.parse().unwrap()
}

pub(crate) struct Made(TempDir);

impl Made {
    /// A dataset with that table in the usual form.
    pub(crate) fn long(table: &str) -> Self {
        Self::new("", "tactile.csv", table)
    }

    /// A dataset with that `[tactile]` and that table.
    pub(crate) fn new(tactile: &str, file: &str, table: impl AsRef<[u8]>) -> Self {
        let made = Self(TempDir::new().unwrap());
        made.write("dataset.toml", format!("{MANIFEST}{tactile}"));
        made.write("surfaces.csv", SURFACES);
        made.write(file, table);
        made
    }

    pub(crate) fn write(&self, file: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path().join(file), content).unwrap();
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    pub(crate) fn open(&self) -> Result<DatasetFolder, DatasetError> {
        DatasetFolder::open(self.path(), &ReadSettings::default())
    }

    /// Opens it with that policy for values out of range.
    pub(crate) fn open_with(&self, policy: RangePolicy) -> Result<DatasetFolder, DatasetError> {
        let mut settings = ReadSettings::default();
        settings.tactile.out_of_range = policy;
        DatasetFolder::open(self.path(), &settings)
    }

    /// The message of opening it, after the name of the folder.
    pub(crate) fn refusal(&self) -> String {
        let message = self.open().unwrap_err().to_string();
        let folder = self.path().display().to_string();
        let rest = message.strip_prefix(&folder).unwrap_or(&message);
        rest.trim_start_matches('/').to_owned()
    }
}

/// What is read and what is said of it, a line each; `\n` in the former ends a line.
pub(crate) fn cases(lines: &str) -> impl Iterator<Item = (String, &str)> {
    let lines = lines.lines().map(str::trim);
    let lines: Vec<&str> = lines.filter(|line| !line.is_empty()).collect();
    let pairs = lines.as_chunks().0.to_vec().into_iter();
    pairs.map(|[read, said]: [&str; 2]| (read.replace("\\n", "\n"), said))
}
