//! What some reruns look at: embeddings of the surfaces that they train on, and of the views of
//! others that they are scored on.

use std::ops::Range;
use std::sync::Arc;

use anyhow::{Context, Result};

use super::encoded::Encoded;
use super::stage::Stage;
use super::tables::Tables;
use super::test_views::{TestViews, Wanted};
use super::trials::Planned;

/// Of one encoder.
pub(crate) struct Encodings {
    pub stage: Arc<Stage>,
    /// The splits that look at them.
    pub splits: Range<usize>,
    test: TestViews,
}

impl Encodings {
    /// Of some splits; nothing is seen yet of surfaces that are only scored on.
    pub(super) fn new(stage: Arc<Stage>, splits: Range<usize>) -> Self {
        Self {
            stage,
            splits,
            test: TestViews::default(),
        }
    }

    /// Embeds what the trials of each method look at of surfaces that are only scored on.
    pub(super) fn look(&mut self, of: &Encoded<'_, '_>, trials: &[Vec<Planned>]) -> Result<()> {
        let tables = &self.stage.tables;
        let mut wanted = Wanted::default();
        for (method, planned) in of.methods.iter().zip(trials) {
            for trial in planned {
                let split = &of.splits.all[trial.split];
                let beyond = beyond(tables, method.scored_on(&split.validation).last());
                for place in trial.views.shown() {
                    wanted.add(tables.views[place], beyond);
                }
            }
        }
        self.test = TestViews::embed(of.experiment, of.source, &self.stage, &wanted)?;
        Ok(())
    }

    /// Embeds every view of every surface that is only scored on.
    pub(super) fn look_at_all(&mut self, of: &Encoded<'_, '_>) -> Result<()> {
        let tables = &self.stage.tables;
        let splits = of.splits.all.iter();
        let last = splits.filter_map(|split| split.validation.last());
        let wanted = Wanted::of(&tables.views, beyond(tables, last.max()));
        self.test = TestViews::embed(of.experiment, of.source, &self.stage, &wanted)?;
        Ok(())
    }

    /// Of one stage, with these views of all surfaces that are only scored on.
    pub(crate) fn with_test_views(
        of: &Encoded<'_, '_>,
        stage: Arc<Stage>,
        places: &[usize],
    ) -> Result<Self> {
        let views = places.iter().map(|&place| &stage.tables.views[place]);
        let wanted = Wanted::of(views, of.source.surfaces().len() - of.splits.pool);
        Ok(Self {
            test: TestViews::embed(of.experiment, of.source, &stage, &wanted)?,
            stage,
            splits: 0..0,
        })
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
                    Some(number) => self.test.get(number, tables.views[place]),
                };
                values.extend(row.context("a view that was not embedded")?);
            }
        }
        Ok(self
            .stage
            .embedder
            .table(&values, surfaces.len(), places.len())?)
    }

    /// A hash of what a trial is scored on: these views, and the readings, of these surfaces.
    pub(crate) fn fingerprint(&self, places: &[usize], surfaces: &[usize]) -> blake3::Hash {
        let tables = &self.stage.tables;
        let mut hasher = blake3::Hasher::new();
        let beyond = surfaces.iter().filter(|&&surface| surface >= tables.pool());
        let count = beyond.clone().count();
        for &place in places {
            let view = self.test.fingerprint(tables.views[place], count);
            hasher.update(view.as_bytes());
        }
        tables.hash_readings(beyond.copied(), &mut hasher);
        hasher.finalize()
    }
}

/// How many of the surfaces that are only scored on there are up to this one.
fn beyond(tables: &Tables, last: Option<&usize>) -> usize {
    last.map_or(0, |last| last + 1)
        .saturating_sub(tables.pool())
}
