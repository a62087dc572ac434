//! What is to be computed: a trial for each method, property and rerun.

use std::collections::BTreeSet;

use anyhow::Result;
use serde::Serialize;
use sps_dataset::{Property, Split};
use sps_regress::{Plan, Rerun, Trial, Views};

use super::found::Selections;
use super::views::{self, TrialViews};
use super::{Encodings, Tables};
use crate::config::{Adaptive, Experiment, Method};
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

/// The trials of one method on some of the splits, property by property.
pub(crate) fn planned(
    experiment: &Experiment,
    method: &Method,
    tables: &Tables,
    splits: &[Split],
    some: &BTreeSet<usize>,
    selections: &Selections,
) -> Result<Vec<Planned>> {
    let mut all = Vec::new();
    for property in &tables.properties {
        for &at in some {
            let trial = (property, at);
            let split = &splits[at];
            let views = views::of_trial(experiment, method, tables, split, trial, selections)?;
            all.push(Planned {
                property: property.clone(),
                split: at,
                views,
            });
        }
    }
    Ok(all)
}

pub(crate) fn keyed(
    experiment: &Experiment,
    method: &Method,
    encodings: &Encodings,
    splits: &[Split],
    planned: Vec<Planned>,
) -> Result<Vec<TrialSpec>> {
    let keyed = planned.into_iter().map(|planned| {
        let split = &splits[planned.split];
        Ok(TrialSpec {
            key: key(experiment, method, encodings, split, &planned)?,
            property: planned.property,
            rerun: planned.split,
            views: planned.views,
        })
    });
    keyed.collect()
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

fn key(
    experiment: &Experiment,
    method: &Method,
    encodings: &Encodings,
    split: &Split,
    planned: &Planned,
) -> Result<TrialKey> {
    let scored_on = method.scored_on(&split.validation);
    let views = &planned.views;
    let held_out = encodings.fingerprint(&views.shown(), scored_on);
    TrialKey::of(&Inputs {
        code: env!("SOURCE_HASH"),
        data: encodings.stage.tables.fingerprint().to_hex().to_string(),
        held_out: held_out.to_hex().to_string(),
        seed: experiment.seed,
        id: &method.id,
        method: method.estimator.settings()?,
        adaptive: method.adaptive,
        range: method
            .adaptive
            .and(encodings.stage.tables.range(&planned.property)),
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

/// The plan to train `trials`.
pub(crate) fn plan<'a>(
    seed: u64,
    splits: &[Split],
    trials: impl Iterator<Item = &'a TrialSpec>,
) -> Plan {
    let reruns = splits.iter().enumerate().map(|(number, split)| Rerun {
        number: number as u64,
        training: split.train.clone(),
        validation: Vec::new(),
    });
    let trials = trials.map(|trial| Trial {
        property: trial.property.to_string(),
        rerun: trial.rerun as u64,
        views: trial.views.training.clone(),
    });
    Plan {
        seed,
        reruns: reruns.collect(),
        trials: trials.collect(),
    }
}
