//! Files by patterns.

use std::path::{Path, PathBuf};

use anyhow::Result;
use glob::{Pattern, glob};

/// The files below `root` that match a pattern, by name.
pub(crate) fn matching(root: &Path, pattern: &str) -> Result<Vec<PathBuf>> {
    let root = Pattern::escape(&root.to_string_lossy());
    let pattern = Path::new(&root).join(pattern);
    let paths = glob(&pattern.to_string_lossy())?;
    Ok(paths.collect::<Result<_, _>>()?)
}
