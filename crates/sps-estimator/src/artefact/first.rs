//! Artefacts of format 1: one photograph straight down, intervals of one width.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use sps_dataset::{DecodeSettings, Unit};
use sps_metrics::Level;
use sps_models::fitted_from_bytes;

use super::{ENCODER, NOT_KEPT, encoder, read, read_checked};
use crate::embedder::{Embedder, Network};
use crate::error::{Error, Result};
use crate::estimator::{About, Estimator};
use crate::fitted::{Fitted, FittedOn, Group, Interval, Measure, Stage};
use crate::step::Step;

pub(super) const CARD: &str = "model.json";
/// The files that hold models, with their kinds.
const MODELS: [(&str, &str); 3] = [
    ("heads.safetensors", "heads"),
    ("kernel-ridges.safetensors", "kernel-ridges"),
    ("ridges.json", "ridges"),
];

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct First {
    format: u64,
    experiment: String,
    method: String,
    data: String,
    encoder: String,
    #[serde(default)]
    precision: Option<String>,
    resize: Option<usize>,
    frame_size: [usize; 2],
    level: Level,
    radius: BTreeMap<String, f64>,
    #[serde(default)]
    no_interval: BTreeMap<String, String>,
    checksums: BTreeMap<String, String>,
}

/// Reads one; it knows neither what it was fitted on nor what is familiar.
pub(super) fn load(folder: &Path) -> Result<Estimator> {
    let path = folder.join(CARD);
    let card: First =
        serde_json::from_slice(&read(&path)?).map_err(|error| Error::artefact(&path, error))?;
    if card.format != 1 {
        return Err(Error::artefact(
            &path,
            format!("format {}, expected 1", card.format),
        ));
    }
    let weights = read_checked(folder, ENCODER, &card.checksums)?;
    let encoder = encoder(
        &card.encoder,
        card.precision.as_deref().unwrap_or("f32"),
        &weights,
    )?;
    let known = MODELS
        .iter()
        .find(|(file, _)| card.checksums.contains_key(*file));
    let Some((file, kind)) = known else {
        return Err(Error::artefact(
            &path,
            "no models, expected heads or ridges",
        ));
    };
    let models = fitted_from_bytes(kind, file, &read_checked(folder, file, &card.checksums)?)?;
    let measures = models.trials().into_iter().map(|trial| {
        let property = &trial.property;
        let interval = match card.radius.get(property) {
            Some(radius) if radius.is_finite() && *radius >= 0.0 => Interval::Errors(*radius),
            _ => Interval::None(card.no_interval.get(property).cloned().unwrap_or_default()),
        };
        Measure {
            property: property.clone(),
            lowest: None,
            highest: None,
            deviation: 1.0,
            interval,
            several: None,
        }
    });
    let measures: Vec<Measure> = measures.collect();
    let fitted = Fitted {
        stages: vec![Stage {
            views: 1,
            groups: vec![Group {
                properties: (0..measures.len()).collect(),
                slots: vec![0],
                step: Step {
                    views: 1,
                    models,
                    errors: None,
                    least: vec![1.0; measures.len()],
                },
            }],
        }],
        familiar: Err(NOT_KEPT.to_owned()),
        level: card.level,
        on: FittedOn {
            surfaces: 0,
            units: 0,
            unit: Unit::Surface,
        },
        width: encoder.width(),
        measures,
    };
    let about = About {
        name: card.experiment,
        method: card.method,
        data: card.data,
        source: String::new(),
        frame_size: card.frame_size,
        angles: vec![0.0],
        decode: DecodeSettings::default(),
        described: BTreeMap::new(),
        measured: BTreeMap::new(),
    };
    Estimator::new(
        Embedder::new(Network::Images(encoder), card.resize)?,
        fitted,
        about,
    )
}
