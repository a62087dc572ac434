//! The scores of a finished run.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, ensure};

use crate::checksums;
use crate::results::Results;

/// Every score of every method and property.
pub(crate) fn of_run(folder: &Path) -> Result<BTreeMap<String, Option<f64>>> {
    checksums::ensure_finished(folder, &["results.json"])?;
    let results = Results::read(folder)?;
    let mut scores = BTreeMap::new();
    for method in &results.methods {
        let kinds = [
            ("R²", &method.scores.r2),
            ("MAE", &method.scores.mae),
            ("median % error", &method.scores.median_percent_error),
        ];
        for (kind, values) in kinds {
            let named = values
                .iter()
                .map(|(property, value)| (format!("{}: {kind} {property}", method.id), *value));
            scores.extend(named);
        }
    }
    ensure!(!scores.is_empty(), "{} has no scores", folder.display());
    Ok(scores)
}
