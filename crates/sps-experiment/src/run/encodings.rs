//! What some reruns look at: embeddings of the surfaces that they train on, and of the views of
//! others that they are scored on.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

use anyhow::{Context, Result};
use sps_dataset::{Source, Split};

use super::stage::{Stage, Stages};
use super::tables::Tables;
use super::test_views::{TestViews, Wanted};
use super::trials::Planned;
use crate::config::{EncoderSpec, Experiment, Method};

/// Of one encoder.
pub(crate) struct Encodings {
    pub stage: Arc<Stage>,
    /// The splits that look at them.
    pub splits: Range<usize>,
    test: TestViews,
}

impl Encodings {
    /// Of all splits together, or of each of `some` on its own where an encoder learns from each.
    pub(crate) fn of_splits(
        stages: &Stages<'_>,
        encoder: &EncoderSpec,
        splits: &[Split],
        some: &BTreeSet<usize>,
    ) -> Result<Vec<Self>> {
        let of = |some: Range<usize>| {
            let stage = stages.of(&splits[some.start].train)?;
            Ok(Self {
                stage,
                splits: some,
                test: TestViews::default(),
            })
        };
        if !encoder.learns() {
            return Ok(vec![of(0..splits.len())?]);
        }
        some.iter().map(|&split| of(split..split + 1)).collect()
    }

    /// Embeds what the trials look at of surfaces that are only scored on.
    pub(crate) fn look<'a>(
        &mut self,
        experiment: &Experiment,
        source: &dyn Source,
        splits: &[Split],
        trials: impl Iterator<Item = (&'a Method, &'a [Planned])>,
    ) -> Result<()> {
        let tables = &self.stage.tables;
        let mut wanted = Wanted::default();
        for (method, planned) in trials {
            for trial in planned {
                let scored_on = method.scored_on(&splits[trial.split].validation);
                let beyond = beyond(tables, scored_on.last());
                for place in trial.views.shown() {
                    wanted.add(tables.views[place], beyond);
                }
            }
        }
        self.test = TestViews::embed(experiment, source, &self.stage, &wanted)?;
        Ok(())
    }

    /// Embeds every view of every surface that is only scored on.
    pub(crate) fn look_at_all(
        &mut self,
        experiment: &Experiment,
        source: &dyn Source,
        splits: &[Split],
    ) -> Result<()> {
        let tables = &self.stage.tables;
        let last = splits.iter().filter_map(|split| split.validation.last());
        let beyond = beyond(tables, last.max());
        let wanted = Wanted::of(&tables.views, beyond);
        self.test = TestViews::embed(experiment, source, &self.stage, &wanted)?;
        Ok(())
    }

    /// Of one stage, with these views of the first so many surfaces that are only scored on.
    pub(crate) fn with_test_views(
        experiment: &Experiment,
        source: &dyn Source,
        stage: Arc<Stage>,
        places: &[usize],
        surfaces: usize,
    ) -> Result<Self> {
        let views = places.iter().map(|&place| &stage.tables.views[place]);
        let wanted = Wanted::of(views, surfaces);
        Ok(Self {
            test: TestViews::embed(experiment, source, &stage, &wanted)?,
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
