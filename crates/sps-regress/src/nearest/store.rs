//! Training surfaces as safetensors: those that some trials share are there once, as
//! `i/embeddings`, f32, `(surfaces, views, width)`, and the trials' readings beside them as
//! `i/readings`, f64, `(trials, surfaces)`; the metadata hold the rest as JSON.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::TrainedNearest;
use crate::archive::{Archive, Content, stored_blocks};
use crate::error::Result;
use crate::groups::sharing;
use crate::plan::Trial;
use crate::regressor::check_finite;

static FILE: Archive = Archive {
    what: "nearest neighbours",
    key: "sps-nearest",
    format: 1,
};

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Metadata {
    format: u32,
    /// How many sets of training surfaces there are.
    sets: usize,
    /// The blocks of embeddings; none where they are one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    blocks: Vec<usize>,
    nearests: Vec<Stored>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Stored {
    trial: Trial,
    /// Its set of training surfaces.
    set: usize,
}

pub(super) fn to_bytes(models: &[TrainedNearest]) -> Result<Vec<u8>> {
    let readings = models.iter().flat_map(|one| &one.values);
    check_finite(FILE.what, readings.copied())?;
    let sets = sharing(models.iter().map(|one| &one.embeddings));
    // `set` is set below, where the models that share one stand together.
    let stored = |one: &TrainedNearest| Stored {
        trial: one.trial.clone(),
        set: 0,
    };
    let mut nearests: Vec<Stored> = models.iter().map(stored).collect();
    let mut contents = Vec::with_capacity(2 * sets.len());
    for (at, (embeddings, places)) in sets.iter().enumerate() {
        let values = |&place: &usize| &models[place].values[..];
        let rows: Vec<&[f64]> = places.iter().map(values).collect();
        contents.extend(Content::set(at, embeddings, "readings", &rows));
        for &place in places {
            nearests[place].set = at;
        }
    }
    let metadata = Metadata {
        format: FILE.format,
        sets: sets.len(),
        blocks: stored_blocks(sets.iter().map(|(embeddings, _)| &***embeddings)),
        nearests,
    };
    FILE.write(&metadata, &contents)
}

pub(super) fn from_bytes(bytes: &[u8]) -> Result<Vec<TrainedNearest>> {
    let (metadata, contents) = FILE.read::<Metadata>(bytes)?;
    // Two for each set, and so no more sets than tensors.
    contents.check_count(metadata.sets.saturating_mul(2))?;
    let mut sets = Vec::with_capacity(metadata.sets);
    for at in 0..metadata.sets {
        let (embeddings, rows) = contents.set(at, "readings", &metadata.blocks)?;
        sets.push((Arc::new(embeddings), rows));
    }
    let mut nearests = Vec::with_capacity(metadata.nearests.len());
    for Stored { trial, set } in metadata.nearests {
        let found = sets.get_mut(set);
        let next = found.and_then(|(shared, rows)| Some((shared, rows.next()?)));
        let Some((embeddings, values)) = next else {
            let found = format_args!("no readings of training surfaces {set} for a trial");
            return Err(FILE.refused(found, "some for each trial"));
        };
        nearests.push(TrainedNearest {
            trial,
            embeddings: Arc::clone(embeddings),
            values,
        });
    }
    if sets.iter_mut().any(|(_, rows)| rows.next().is_some()) {
        return Err(FILE.refused("readings of no trial", "none such"));
    }
    Ok(nearests)
}
