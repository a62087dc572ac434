//! Views of surfaces that are only scored on: those alone that some method looks at.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use anyhow::Result;
use sps_dataset::{FrameIndex, Source};

use super::Stage;
use crate::config::Experiment;
use crate::embeddings::embed;

/// Of each view, the embeddings of the first so many surfaces.
#[derive(Default)]
pub(crate) struct TestViews {
    width: usize,
    /// By index of the view in the source, `(surfaces, width)`.
    of_view: BTreeMap<usize, Vec<f32>>,
    /// By view and number of surfaces.
    hashes: Mutex<BTreeMap<(usize, usize), blake3::Hash>>,
}

/// The number of surfaces that each view is looked at of.
#[derive(Default)]
pub(crate) struct Wanted(BTreeMap<usize, usize>);

impl Wanted {
    pub(crate) fn of<'a>(views: impl IntoIterator<Item = &'a usize>, surfaces: usize) -> Self {
        Self(views.into_iter().map(|&view| (view, surfaces)).collect())
    }

    pub(crate) fn add(&mut self, view: usize, surfaces: usize) {
        let most = self.0.entry(view).or_default();
        *most = surfaces.max(*most);
    }
}

impl TestViews {
    /// Embeds what is wanted of the surfaces that are only scored on.
    pub(crate) fn embed(
        experiment: &Experiment,
        source: &dyn Source,
        stage: &Stage,
        wanted: &Wanted,
    ) -> Result<Self> {
        let (embedder, first) = (&stage.embedder, stage.tables.pool());
        let most = wanted.0.values().copied().max().unwrap_or(0);
        let frames: Vec<FrameIndex> = (0..most)
            .flat_map(|surface| {
                let looked_at = wanted.0.iter().filter(move |(_, count)| surface < **count);
                looked_at.map(move |(&view, _)| FrameIndex {
                    surface: first + surface,
                    view,
                })
            })
            .collect();
        let embedded = embed(source, &frames, embedder, experiment)?;
        let mut of_view: BTreeMap<usize, Vec<f32>> = BTreeMap::new();
        for (frame, row) in frames.iter().zip(embedded.values.chunks(embedded.width)) {
            of_view.entry(frame.view).or_default().extend(row);
        }
        Ok(Self {
            width: embedded.width,
            of_view,
            hashes: Mutex::default(),
        })
    }

    /// The embedding of a view of the surface with this number among those that are only scored on.
    pub(crate) fn get(&self, surface: usize, view: usize) -> Option<&[f32]> {
        let rows = self.of_view.get(&view)?;
        rows.get(surface * self.width..(surface + 1) * self.width)
    }

    /// A hash of a view of the first so many surfaces.
    pub(crate) fn fingerprint(&self, view: usize, surfaces: usize) -> blake3::Hash {
        let mut hashes = self.hashes.lock().unwrap_or_else(PoisonError::into_inner);
        *hashes.entry((view, surfaces)).or_insert_with(|| {
            let mut hasher = blake3::Hasher::new();
            let rows = self.of_view.get(&view).into_iter().flatten();
            for value in rows.take(surfaces * self.width) {
                hasher.update(&value.to_le_bytes());
            }
            hasher.finalize()
        })
    }
}
