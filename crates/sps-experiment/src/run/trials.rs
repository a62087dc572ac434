//! Trials, their keys, and the plan to train them.

use anyhow::Result;
use serde::Serialize;
use sps_dataset::{Property, Split};
use sps_regress::{Plan, Rerun, Trial, Views};

use super::fit::Judge;
use super::views::TrialViews;
use crate::config::Adaptive;
use crate::journal::TrialKey;

/// One trial, and what identifies it.
#[derive(Clone, Debug)]
pub(crate) struct TrialSpec {
    pub property: Property,
    /// Which of all splits.
    pub rerun: usize,
    pub views: TrialViews,
    pub key: TrialKey,
}

/// A trial that has its views, but no key yet: the key depends on embeddings of these views.
#[derive(Clone, Debug)]
pub(crate) struct Planned {
    pub property: Property,
    /// Which of all splits.
    pub split: usize,
    pub views: TrialViews,
}

#[derive(Serialize)]
struct Inputs<'a> {
    code: &'static str,
    data: String,
    held_out: String,
    seed: u64,
    id: &'a str,
    method: serde_json::Value,
    adaptive: Option<Adaptive>,
    /// Which bounds the intervals that are made here.
    range: Option<[f64; 2]>,
    property: &'a str,
    /// None where a rerun on the same surfaces is the same: it is fitted once.
    rerun: Option<usize>,
    training: &'a [usize],
    scored_on: &'a [usize],
    training_views: &'a Views,
    views: &'a [Vec<usize>],
}

impl Judge<'_> {
    /// Each of the method's trials with the key of all that its outcome depends on.
    pub(super) fn keyed(&self, planned: Vec<Planned>) -> Result<Vec<TrialSpec>> {
        let keyed = planned.into_iter().map(|planned| {
            Ok(TrialSpec {
                key: self.key(&planned)?,
                property: planned.property,
                rerun: planned.split,
                views: planned.views,
            })
        });
        keyed.collect()
    }

    fn key(&self, planned: &Planned) -> Result<TrialKey> {
        let (method, tables) = (self.method, self.tables());
        let split = &self.splits.all[planned.split];
        let scored_on = method.scored_on(&split.validation);
        let views = &planned.views;
        let held_out = self.encodings.fingerprint(&views.shown(), scored_on);
        TrialKey::of(&Inputs {
            code: env!("SOURCE_HASH"),
            data: tables.fingerprint().to_hex().to_string(),
            held_out: held_out.to_hex().to_string(),
            seed: self.experiment.seed,
            id: &method.id,
            method: method.estimator.settings()?,
            adaptive: method.adaptive,
            range: method.adaptive.and(tables.range(&planned.property)),
            property: planned.property.code(),
            rerun: method
                .differs_by_rerun(split.train.len())
                .then_some(planned.split),
            training: &split.train,
            scored_on,
            training_views: &views.training,
            views: &views.fillings,
        })
    }
}

impl TrialSpec {
    /// As it is trained.
    pub(super) fn trial(&self) -> Trial {
        Trial {
            property: self.property.to_string(),
            rerun: self.rerun as u64,
            views: self.views.training.clone(),
        }
    }
}

/// The plan to train `trials` of reruns that have these splits in turn.
pub(super) fn plan(seed: u64, splits: &[Split], trials: impl Iterator<Item = Trial>) -> Plan {
    let numbered = (0..).zip(splits);
    let reruns = numbered.map(|(number, split)| Rerun::new(number, split.train.iter().copied()));
    Plan {
        seed,
        reruns: reruns.collect(),
        trials: trials.collect(),
    }
}
