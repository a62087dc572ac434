//! Choosing views: an estimator is trained on random sets of views and frozen, and selectors search
//! for the set of lowest loss on the training part (section "Viewpoint Selector Framework" of the
//! paper, stages 1 and 2). Stage 3, training with the found set, is a trial like any other.

use std::collections::BTreeMap;
use std::ops::Range;

use anyhow::{Context, Result};
use serde::Serialize;
use sps_dataset::Property;
use sps_models::heads::Head;
use sps_viewselect::Problem;

use super::found::{Found, Selections};
use super::frozen::{Folds, FrozenLoss};
use super::refit::Refits;
use super::views::{seed, without_loss};
use crate::config::{JudgedOn, Looks, Method, Refit, Selected};
use crate::journal::{Journal, TrialKey};
use crate::progress::Progress;

/// Random sets whose mean loss stands for that of a random set.
const RANDOM_SETS: usize = 2000;

/// What selections are made on.
pub(crate) struct Selecting<'a> {
    pub folds: Folds<'a>,
    pub journal: &'a mut Journal<Found>,
}

impl Selecting<'_> {
    /// Selects views for those of the methods that want some, in the given reruns.
    pub(crate) fn run(
        &mut self,
        methods: &[&Method],
        reruns: Range<usize>,
        selections: &mut Selections,
    ) -> Result<()> {
        let families = families(methods)?;
        for family in families.values() {
            let wanted = self.wanted(family, reruns.clone())?;
            self.run_missing(family, &wanted)?;
            for one in wanted {
                let found = self.journal.get(&one.key);
                let found = found.context("views were not selected")?.clone();
                selections.insert(&one.method.id, one.property, one.rerun, found);
            }
        }
        Ok(())
    }

    /// Every selection that the methods of a family need, property by property.
    fn wanted<'m>(&self, family: &Family<'m>, reruns: Range<usize>) -> Result<Vec<Wanted<'m>>> {
        let mut wanted = Vec::new();
        for &property in &self.folds.encodings.stage.tables.properties {
            for rerun in reruns.clone() {
                for &(method, selected) in &family.members {
                    wanted.push(Wanted {
                        method,
                        selected,
                        property,
                        rerun,
                        key: self.key(family, selected, property, rerun)?,
                    });
                }
            }
        }
        Ok(wanted)
    }

    fn key(
        &self,
        family: &Family<'_>,
        selected: &Selected,
        property: Property,
        rerun: usize,
    ) -> Result<TrialKey> {
        let tables = &self.folds.encodings.stage.tables;
        TrialKey::of(&Inputs {
            code: env!("SOURCE_HASH"),
            data: tables.fingerprint().to_hex().to_string(),
            views: tables.all_views,
            seed: self.folds.experiment.seed,
            folds: self.folds.experiment.selection_folds,
            frozen: family.frozen.map(Head::config),
            selected,
            refit: selected
                .refit
                .as_ref()
                .map(|refit| self.refit_inputs(refit, rerun)),
            property: property.code(),
            rerun,
            training: &self.folds.splits.all[rerun].train,
        })
    }

    /// What a choice by refits depends on beside the training surfaces and the property's own
    /// readings: the properties that it is pooled over, and what hindsight looks at.
    fn refit_inputs(&self, refit: &Refit, rerun: usize) -> RefitInputs {
        let tables = &self.folds.encodings.stage.tables;
        let held_out = || {
            let places: Vec<usize> = (0..tables.views.len()).collect();
            let surfaces = &self.folds.splits.all[rerun].validation;
            self.folds
                .encodings
                .fingerprint(&places, surfaces)
                .to_hex()
                .to_string()
        };
        RefitInputs {
            properties: tables.codes(),
            held_out: (refit.judged_on == JudgedOn::HeldOut).then(held_out),
        }
    }

    fn run_missing(&mut self, family: &Family<'_>, wanted: &[Wanted<'_>]) -> Result<()> {
        let missing: Vec<&Wanted<'_>> = wanted
            .iter()
            .filter(|wanted| self.journal.get(&wanted.key).is_none())
            .collect();
        let same_trial = |a: &&Wanted<'_>, b: &&Wanted<'_>| a.trial() == b.trial();
        let estimators = match family.frozen {
            Some(head) if !missing.is_empty() => {
                let trials = missing.chunk_by(same_trial).map(|chunk| chunk[0].trial());
                Some(self.folds.train(head, trials)?)
            }
            _ => None,
        };
        let mut refits = Refits::new(
            self.folds.encodings,
            self.folds.splits,
            self.folds.experiment.seed,
        );
        let progress = Progress::new("views selected", missing.len());
        for chunk in missing.chunk_by(same_trial) {
            let (property, rerun) = chunk[0].trial();
            let loss = estimators.as_ref();
            let loss = loss.map(|estimators| self.folds.loss(estimators, property, rerun));
            let loss = loss.transpose()?;
            for wanted in chunk {
                progress.say(&format!("{}, {}", wanted.method.label, wanted.property));
                let found = match &wanted.selected.refit {
                    Some(refit) => self.refitted(&mut refits, refit, wanted),
                    None => self.select(loss.as_ref(), wanted),
                };
                let doing = || format!("method `{}`, {}", wanted.method.id, wanted.property);
                let found = found.with_context(doing)?;
                self.journal.append(vec![found])?;
                progress.advance(1);
            }
        }
        Ok(())
    }

    /// The choice by a regression that is fitted anew to each set.
    fn refitted(
        &self,
        refits: &mut Refits<'_>,
        refit: &Refit,
        wanted: &Wanted<'_>,
    ) -> Result<Found> {
        let properties = &self.folds.encodings.stage.tables.properties;
        let place = properties
            .iter()
            .position(|property| *property == wanted.property);
        let place = place.context("a property that is not estimated")?;
        let key = wanted.key.clone();
        refits.select(key, wanted.selected, refit, place, wanted.rerun)
    }

    /// Stage 2.
    fn select(&self, loss: Option<&FrozenLoss>, wanted: &Wanted<'_>) -> Result<Found> {
        let (selected, key) = (wanted.selected, wanted.key.clone());
        let seed = seed(
            self.folds.experiment.seed,
            wanted.property.code(),
            wanted.rerun,
        );
        let Some(loss) = loss else {
            return Ok(Found {
                key,
                selection: without_loss(
                    selected,
                    self.folds.encodings.stage.tables.all_views,
                    seed,
                )?,
                random_loss: None,
            });
        };
        let problem = Problem::new(loss)?.distinct(selected.distinct).seed(seed);
        Found::search(key, selected, &problem, RANDOM_SETS)
    }
}

/// Methods that share an estimator to search.
struct Family<'m> {
    /// The estimator, where any of the methods searches it.
    frozen: Option<&'m Head>,
    members: Vec<(&'m Method, &'m Selected)>,
}

fn families<'m>(methods: &[&'m Method]) -> Result<BTreeMap<String, Family<'m>>> {
    let mut families: BTreeMap<String, Family<'_>> = BTreeMap::new();
    for method in methods {
        let Looks::Selected(selected) = &method.looks else {
            continue;
        };
        let head = method.estimator.head();
        let name = serde_json::to_string(&head.map(Head::config))?;
        let family = families.entry(name).or_insert(Family {
            frozen: None,
            members: Vec::new(),
        });
        if selected.learns() && selected.refit.is_none() {
            family.frozen = head;
        }
        family.members.push((method, selected));
    }
    Ok(families)
}

/// A selection that is needed.
struct Wanted<'m> {
    method: &'m Method,
    selected: &'m Selected,
    property: Property,
    rerun: usize,
    key: TrialKey,
}

impl Wanted<'_> {
    fn trial(&self) -> (Property, usize) {
        (self.property, self.rerun)
    }
}

/// All that a selection depends on.
#[derive(Serialize)]
struct Inputs<'a> {
    code: &'static str,
    data: String,
    views: usize,
    seed: u64,
    folds: usize,
    frozen: Option<&'a sps_models::heads::HeadConfig>,
    selected: &'a Selected,
    refit: Option<RefitInputs>,
    property: &'a str,
    rerun: usize,
    training: &'a [usize],
}

#[derive(Serialize)]
struct RefitInputs {
    properties: Vec<String>,
    held_out: Option<String>,
}
