//! What some reruns look at: embeddings of the surfaces that they train on and, of others that they are
//! scored on, of those views alone that some method looks at.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result};
use sps_dataset::FrameIndex;

use super::encoded::Encoded;
use super::stage::Stage;
use super::trials::Planned;
use crate::embeddings::embed;

/// Of one encoder.
pub(crate) struct Encodings {
    pub stage: Arc<Stage>,
    /// The splits that look at them.
    pub splits: Range<usize>,
    /// By index of the view in the source, `(surfaces, width)`: the first of those only scored on.
    test_views: BTreeMap<usize, Vec<f32>>,
    /// Of `test_views`, by view and number of surfaces.
    hashes: Mutex<BTreeMap<(usize, usize), blake3::Hash>>,
}

impl Encodings {
    /// Of some splits; nothing is seen yet of surfaces that are only scored on.
    pub(crate) fn new(stage: Arc<Stage>, splits: Range<usize>) -> Self {
        Self {
            stage,
            splits,
            test_views: BTreeMap::new(),
            hashes: Mutex::default(),
        }
    }

    /// Embeds what the trials of each method look at of surfaces that are only scored on.
    pub(super) fn look(&mut self, of: &Encoded<'_, '_>, trials: &[Vec<Planned>]) -> Result<()> {
        let tables = &self.stage.tables;
        let mut wanted = BTreeMap::new();
        for (method, planned) in of.methods.iter().zip(trials) {
            for trial in planned {
                let split = &of.splits.all[trial.split];
                let last = method.scored_on(&split.validation).last();
                let beyond = last.map_or(0, |last| (last + 1).saturating_sub(tables.pool()));
                for place in trial.views.shown() {
                    let most = wanted.entry(tables.views[place]).or_default();
                    *most = beyond.max(*most);
                }
            }
        }
        self.embed(of, &wanted)
    }

    /// Embeds views, given by their places in the tables, of every surface that is only scored on.
    pub(crate) fn look_at(
        &mut self,
        of: &Encoded<'_, '_>,
        places: impl IntoIterator<Item = usize>,
    ) -> Result<()> {
        let count = of.source.surfaces().len() - self.stage.tables.pool();
        let views = places.into_iter();
        let wanted = views.map(|place| (self.stage.tables.views[place], count));
        self.embed(of, &wanted.collect())
    }

    /// The same of all views.
    pub(super) fn look_at_all(&mut self, of: &Encoded<'_, '_>) -> Result<()> {
        self.look_at(of, 0..self.stage.tables.views.len())
    }

    /// Embeds so many surfaces, in each of these views, of those that are only scored on.
    fn embed(&mut self, of: &Encoded<'_, '_>, wanted: &BTreeMap<usize, usize>) -> Result<()> {
        let (embedder, first) = (&self.stage.embedder, self.stage.tables.pool());
        let most = wanted.values().copied().max().unwrap_or(0);
        let frames = (0..most).flat_map(|surface| {
            let looked_at = wanted.iter().filter(move |(_, count)| surface < **count);
            looked_at.map(move |(&view, _)| FrameIndex {
                surface: first + surface,
                view,
            })
        });
        let frames: Vec<FrameIndex> = frames.collect();
        let (values, _) = embed(of.source, &frames, embedder, of.experiment)?;
        self.test_views.clear();
        for (frame, row) in frames.iter().zip(values.chunks(embedder.width())) {
            self.test_views.entry(frame.view).or_default().extend(row);
        }
        self.hashes = Mutex::default();
        Ok(())
    }

    /// Embeddings of these views, given by their places in the tables, of any of the surfaces.
    pub(crate) fn select(
        &self,
        surfaces: &[usize],
        places: &[usize],
    ) -> Result<sps_regress::Embeddings> {
        let tables = &self.stage.tables;
        if surfaces.iter().all(|&surface| surface < tables.pool()) {
            return Ok(tables.embeddings.select(surfaces, places)?);
        }
        let width = tables.embeddings.width();
        let mut values = Vec::with_capacity(surfaces.len() * places.len() * width);
        for &surface in surfaces {
            for &place in places {
                let row = match surface.checked_sub(tables.pool()) {
                    None => tables.embeddings.get(surface, place),
                    Some(number) => {
                        let rows = self.test_views.get(&tables.views[place]);
                        rows.and_then(|rows| rows.get(number * width..(number + 1) * width))
                    }
                };
                values.extend(row.context("a view that was not embedded")?);
            }
        }
        let embedder = &self.stage.embedder;
        Ok(embedder.table(&values, surfaces.len(), places.len())?)
    }

    /// A hash of what a trial is scored on: these views, and the readings, of these surfaces.
    pub(crate) fn fingerprint(&self, places: &[usize], surfaces: &[usize]) -> blake3::Hash {
        let tables = &self.stage.tables;
        let mut hasher = blake3::Hasher::new();
        let beyond = surfaces.iter().filter(|&&surface| surface >= tables.pool());
        let count = beyond.clone().count();
        for &place in places {
            let view = self.fingerprint_of(tables.views[place], count);
            hasher.update(view.as_bytes());
        }
        tables.hash_readings(beyond.copied(), &mut hasher);
        hasher.finalize()
    }

    /// A hash of a view of the first so many surfaces that are only scored on.
    fn fingerprint_of(&self, view: usize, surfaces: usize) -> blake3::Hash {
        let width = self.stage.tables.embeddings.width();
        let mut hashes = self.hashes.lock().unwrap_or_else(PoisonError::into_inner);
        *hashes.entry((view, surfaces)).or_insert_with(|| {
            let mut hasher = blake3::Hasher::new();
            let rows = self.test_views.get(&view).into_iter().flatten();
            for value in rows.take(surfaces * width) {
                hasher.update(&value.to_le_bytes());
            }
            hasher.finalize()
        })
    }
}
