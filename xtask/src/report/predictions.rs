//! `predictions.csv`: every held-out estimate beside its measured value.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use crate::files::write_atomically;
use crate::journal::Outcome;

/// One estimate for one held-out surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Prediction {
    pub method: String,
    pub property: String,
    pub rerun: usize,
    pub surface: String,
    pub truth: f64,
    pub estimate: f64,
    /// The surface's group; empty where surfaces do not come in groups that are kept whole.
    #[serde(default)]
    pub group: String,
}

/// The file in the folder of a run.
pub(super) const FILE: &str = "predictions.csv";

/// The predictions of finished trials, in their order; `groups` has the groups of surfaces by name.
pub(crate) fn of_outcomes<'a>(
    outcomes: impl Iterator<Item = &'a Outcome>,
    groups: &HashMap<&str, &str>,
) -> Vec<Prediction> {
    let group = |surface: &str| groups.get(surface).copied().unwrap_or_default().to_owned();
    outcomes
        .flat_map(|outcome| {
            let values = outcome.truth.iter().zip(&outcome.estimate);
            outcome
                .surfaces
                .iter()
                .zip(values)
                .map(|(surface, (truth, estimate))| Prediction {
                    method: outcome.method.clone(),
                    property: outcome.property.clone(),
                    rerun: outcome.rerun,
                    surface: surface.clone(),
                    truth: *truth,
                    estimate: *estimate,
                    group: group(surface),
                })
        })
        .collect()
}

/// Writes `predictions.csv` into `folder`.
pub(crate) fn write(folder: &Path, predictions: &[Prediction]) -> Result<()> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for prediction in predictions {
        writer.serialize(prediction)?;
    }
    write_atomically(&folder.join(FILE), &writer.into_inner()?)
}

/// Reads `predictions.csv` from `folder`.
pub(crate) fn read(folder: &Path) -> Result<Vec<Prediction>> {
    let path = folder.join(FILE);
    let failed = || format!("cannot read {}", path.display());
    let mut reader = csv::Reader::from_path(&path).with_context(failed)?;
    reader
        .deserialize()
        .collect::<Result<_, _>>()
        .with_context(failed)
}
