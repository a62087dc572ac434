//! Embeddings of what is imported.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use sps_estimator::Precomputed;

use super::{Import, photographs_below};

impl Import {
    /// The rows of the photographs that are imported, in the order of the dataset. Rows that name no `files` are
    /// of all photographs below `folder`, by name; without a folder, of those imported, in their order.
    ///
    /// # Errors
    /// Another number of rows where no files are named; a photograph without a row, or with two.
    pub fn rows_of(&self, mut rows: Precomputed, folder: Option<&Path>) -> Result<Precomputed> {
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let blocks = rows.blocks().to_vec();
        if let (Some(folder), []) = (folder, rows.files()) {
            let all = photographs_below(folder)?;
            ensure!(
                rows.rows() == all.len(),
                "found {} rows without `files`, expected {}, one for each photograph below {}",
                rows.rows(),
                all.len(),
                folder.display()
            );
            let files = all.iter().map(|path| text(path)).collect();
            rows = Precomputed::new(blocks.clone(), files, rows.values().to_vec())?;
        }
        let root = match folder {
            Some(folder) => {
                fs::canonicalize(folder).with_context(|| folder.display().to_string())?
            }
            None => PathBuf::new(),
        };
        let wanted = self
            .photographs()
            .map(|path| text(path.strip_prefix(&root).unwrap_or(path)));
        let values = rows.rows_of(&wanted.collect::<Vec<_>>())?;
        Ok(Precomputed::new(blocks, Vec::new(), values)?)
    }
}
