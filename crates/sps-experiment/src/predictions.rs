//! `predictions.csv`: every held-out estimate beside its measured value.

use std::collections::HashMap;
use std::fs::File;
use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use sps_base::parallel;

use crate::files::write_atomically;
use crate::journal::Outcome;

/// One estimate for one held-out surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Prediction {
    /// Id of the method.
    pub method: String,
    /// Code of the property.
    pub property: String,
    /// From 0.
    pub rerun: usize,
    /// Name of the surface.
    pub surface: String,
    /// As it was measured.
    pub truth: f64,
    /// As it was estimated.
    pub estimate: f64,
    /// The surface's group; empty where surfaces do not come in groups that are kept whole.
    pub group: String,
    /// Where a method stops when it is sure: how many views it looked at.
    pub views: Option<usize>,
    /// The interval, where the method made one.
    pub low: Option<f64>,
    /// Its upper end.
    pub high: Option<f64>,
}

impl Prediction {
    /// The interval that its method gave it.
    pub fn interval(&self) -> Option<[f64; 2]> {
        Some([self.low?, self.high?])
    }
}

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
            let surfaces = outcome.surfaces.iter().zip(values).enumerate();
            surfaces.map(move |(at, (surface, (truth, estimate)))| {
                let stop = outcome.stops.get(at);
                Prediction {
                    method: outcome.method.clone(),
                    property: outcome.property.clone(),
                    rerun: outcome.rerun,
                    surface: surface.clone(),
                    truth: *truth,
                    estimate: *estimate,
                    group: group(surface),
                    views: stop.map(|stop| stop.views).filter(|&views| views > 0),
                    low: stop.map(|stop| stop.low),
                    high: stop.map(|stop| stop.high),
                }
            })
        })
        .collect()
}

/// Writes those of finished trials, as [`of_outcomes`] takes them.
pub(crate) fn write<'a>(
    folder: &Path,
    outcomes: impl Iterator<Item = &'a Outcome>,
    groups: &HashMap<&str, &str>,
) -> Result<()> {
    // The first that has lines writes their header.
    let outcomes = outcomes.filter(|outcome| !outcome.truth.is_empty());
    let lines = parallel::map(outcomes.enumerate(), |(at, outcome)| {
        let mut writer = csv::WriterBuilder::new();
        let mut writer = writer.has_headers(at == 0).from_writer(Vec::new());
        let mut predictions = of_outcomes([outcome].into_iter(), groups).into_iter();
        predictions.try_for_each(|prediction| writer.serialize(prediction))?;
        Ok(writer.into_inner()?)
    });
    let lines = lines.into_iter().collect::<Result<Vec<Vec<u8>>>>()?;
    write_atomically(&folder.join(FILE), &lines.concat())
}

/// Reads `predictions.csv` from `folder`.
///
/// # Errors
/// A file that cannot be read or is damaged.
pub fn read(folder: &Path) -> Result<Vec<Prediction>> {
    of_methods(folder, |_| true)
}

/// The predictions of some methods: those of all may be many times as many.
///
/// # Errors
/// A file that cannot be read or is damaged.
pub fn of_methods(folder: &Path, is_wanted: impl Fn(&str) -> bool) -> Result<Vec<Prediction>> {
    let path = folder.join(FILE);
    let failed = || format!("cannot read {}", path.display());
    let file = File::open(&path).with_context(failed)?;
    let mut reader = csv::Reader::from_reader(file);
    let header = reader.headers().with_context(failed)?.clone();
    let method = header.iter().position(|column| column == "method");
    let method = method.context("no column `method`").with_context(failed)?;
    let (mut predictions, mut line) = (Vec::new(), csv::StringRecord::new());
    while reader.read_record(&mut line).with_context(failed)? {
        if line.get(method).is_some_and(&is_wanted) {
            let prediction = line.deserialize(Some(&header));
            predictions.push(prediction.with_context(failed)?);
        }
    }
    Ok(predictions)
}
