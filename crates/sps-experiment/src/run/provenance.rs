//! What the results of a run come from.

use std::collections::BTreeSet;

use anyhow::Result;
use sps_dataset::{Source, Surface};

use super::tables::{hash_row, hash_text, readings};
use crate::config::{Experiment, Method};
use crate::data::{self, About};
use crate::machine::processor;
use crate::results::{Provenance, SCHEMA};

pub(super) fn of(
    experiment: &Experiment,
    source: &dyn Source,
    about: &About,
) -> Result<Provenance> {
    let methods = experiment.methods.iter();
    let precision: BTreeSet<String> = methods.filter_map(Method::precision).collect();
    Ok(Provenance {
        schema: SCHEMA,
        source_hash: env!("SOURCE_HASH").to_owned(),
        config_hash: blake3::hash(experiment.resolved.as_bytes()).to_string(),
        data_hash: data_hash(source, about)?.to_string(),
        seed: experiment.seed,
        data_seed: about.seed,
        cpu: processor(),
        threads: rayon::current_num_threads(),
        precision: precision.into_iter().collect(),
    })
}

/// Of everything that is the same for all methods. Of the frames it has those straight down: to
/// read all would cost more than most experiments, which look at few.
pub(super) fn data_hash(source: &dyn Source, about: &About) -> Result<blake3::Hash> {
    let mut hasher = blake3::Hasher::new();
    for angle in source.view_angles() {
        hasher.update(&angle.0.to_le_bytes());
    }
    let surfaces = source.surfaces();
    let readings = readings(source, about, surfaces.len())?;
    for property in readings.properties() {
        hash_text(&mut hasher, property);
    }
    let nadir = data::nadir(source)?;
    for (at, surface) in surfaces.iter().enumerate() {
        let Surface {
            id,
            group,
            material,
        } = surface;
        for text in [id, group, material] {
            hash_text(&mut hasher, text);
        }
        hash_row(&mut hasher, &readings, at);
        hasher.update(&source.frame_key(at, nadir)?);
    }
    Ok(hasher.finalize())
}
