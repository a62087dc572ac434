//! The scores of a finished run.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, ensure};

use crate::checksums;
use crate::results::{Kind, Results, kind};

/// Every score that has a mean over properties, of every method and property.
pub(crate) fn of_run(folder: &Path) -> Result<BTreeMap<String, Option<f64>>> {
    checksums::ensure_finished(folder, &["results.json"])?;
    let scores = kind::named(&Results::read(folder)?, &Kind::WITH_MEANS);
    ensure!(!scores.is_empty(), "{} has no scores", folder.display());
    Ok(scores)
}
