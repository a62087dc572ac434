//! What is to be computed: a trial for each method, property and rerun.

use std::ops::Range;

use anyhow::Result;
use serde::Serialize;
use sps_dataset::{Property, Split, Surface};
use sps_models::heads::{Plan, Rerun, Trial, Views};

use super::Tables;
use super::select::Selections;
use super::views::{self, TrialViews};
use crate::config::{AdaptiveKey, Estimator, Experiment, Method};
use crate::journal::TrialKey;

/// One trial, and what identifies it.
#[derive(Clone, Debug)]
pub(crate) struct TrialSpec {
    pub property: Property,
    pub rerun: usize,
    pub views: TrialViews,
    pub key: TrialKey,
}

/// The splits of all reruns, in order; with k folds, a rerun has k.
pub(crate) fn splits(experiment: &Experiment, surfaces: &[Surface]) -> Result<Vec<Split>> {
    let mut splits = Vec::new();
    for rerun in 0..experiment.reruns as u64 {
        splits.extend(experiment.split.splits(surfaces, experiment.seed, rerun)?);
    }
    Ok(splits)
}

/// The trials of one method over some reruns, property by property.
pub(crate) fn trials(
    experiment: &Experiment,
    method: &Method,
    tables: &Tables,
    splits: &[Split],
    reruns: Range<usize>,
    selections: &Selections,
) -> Result<Vec<TrialSpec>> {
    let mut trials = Vec::new();
    for &property in &tables.properties {
        for rerun in reruns.clone() {
            let (split, trial) = (&splits[rerun], (property, rerun));
            let views = views::of_trial(experiment, method, tables, split, trial, selections)?;
            trials.push(TrialSpec {
                key: key(experiment, method, tables, split, trial, &views)?,
                property,
                rerun,
                views,
            });
        }
    }
    Ok(trials)
}

/// All that the outcome of a trial depends on.
#[derive(Serialize)]
struct Inputs<'a> {
    code: &'static str,
    data: String,
    seed: u64,
    id: &'a str,
    method: serde_json::Value,
    adaptive: Option<AdaptiveKey>,
    property: &'a str,
    rerun: usize,
    split: &'a Split,
    training_views: &'a Views,
    views: &'a [Vec<usize>],
}

fn key(
    experiment: &Experiment,
    method: &Method,
    tables: &Tables,
    split: &Split,
    (property, rerun): (Property, usize),
    views: &TrialViews,
) -> Result<TrialKey> {
    TrialKey::of(&Inputs {
        code: env!("SOURCE_HASH"),
        data: tables.fingerprint().to_hex().to_string(),
        seed: experiment.seed,
        id: &method.id,
        method: match &method.estimator {
            Estimator::Head(head) => serde_json::to_value(head.config())?,
            Estimator::Ridge(ridge) => serde_json::to_value(ridge.config())?,
        },
        adaptive: method.adaptive.map(|adaptive| adaptive.key()),
        property: property.code(),
        rerun,
        split,
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
