//! What is wrong with a file, all of it at once.

use std::iter;
use std::path::Path;

use anyhow::{Result, bail};

use crate::text::counted;

/// So many problems are shown; the others are counted.
const SHOWN: usize = 20;

pub(super) struct Problems<'a> {
    file: &'a Path,
    shown: Vec<String>,
    count: usize,
}

impl<'a> Problems<'a> {
    pub(super) fn of(file: &'a Path) -> Self {
        Self {
            file,
            shown: Vec::new(),
            count: 0,
        }
    }

    /// One of a line. It is put into words only where it is shown: names that are near take time.
    pub(super) fn at(&mut self, line: u64, problem: impl FnOnce() -> String) {
        let file = self.file.display();
        self.add(|| format!("{file}, line {line}: {}", problem()));
    }

    /// Gives back `found`; where it is `None`, notes the problem of the line.
    pub(super) fn unless<T>(
        &mut self,
        found: Option<T>,
        line: u64,
        problem: impl FnOnce() -> String,
    ) -> Option<T> {
        if found.is_none() {
            self.at(line, problem);
        }
        found
    }

    /// One of the file as a whole.
    pub(super) fn of_all(&mut self, problem: impl FnOnce() -> String) {
        let file = self.file.display();
        self.add(|| format!("{file}: {}", problem()));
    }

    fn add(&mut self, problem: impl FnOnce() -> String) {
        self.count += 1;
        if self.shown.len() < SHOWN {
            self.shown.push(problem());
        }
    }

    pub(super) fn ensure_none(self) -> Result<()> {
        if self.count == 0 {
            return Ok(());
        }
        let more = self.count - self.shown.len();
        let more = (more > 0).then(|| format!("and {more} more"));
        let lines = iter::once(counted(self.count, "problem")).chain(self.shown);
        bail!(lines.chain(more).collect::<Vec<_>>().join("\n  "))
    }
}
