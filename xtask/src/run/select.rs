//! Choosing views: an estimator is trained on random sets of views and frozen, and selectors search
//! for the set of lowest loss on the training part (section "Viewpoint Selector Framework" of the
//! paper, stages 1 and 2). Stage 3, training with the found set, is a trial like any other.
//!
//! With folds, there is an estimator for each part of the training surfaces, trained on the other
//! parts: a set of views is not rewarded for surfaces that its estimator has learned by heart.

use std::collections::BTreeMap;
use std::ops::Range;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use sps_dataset::{Property, Split};
use sps_models::heads::{
    FusionLoss, Head, Observer, Plan, Rerun, TrainedHeads, TrainingData, Trial, Views,
};
use sps_viewselect::{LossError, Problem, Random, Selection, Selector, SetLoss, Sets};

use super::refit::Refits;
use super::splits::early_stopped;
use super::views::{seed, without_loss};
use super::{Encodings, Splits};
use crate::config::{Experiment, JudgedOn, Looks, Method, Refit, Selected};
use crate::journal::{Journal, Record, TrialKey};
use crate::progress::Progress;

/// Random sets whose mean loss stands for that of a random set.
const RANDOM_SETS: usize = 2000;

/// What a selector found for one property and rerun.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Found {
    pub key: TrialKey,
    /// Picks are indices of the source's views; losses are in units of the variance of the training
    /// readings.
    pub selection: Selection,
    /// Mean loss of random sets; none where no loss was asked for.
    pub random_loss: Option<f64>,
}

impl Record for Found {
    fn key(&self) -> &TrialKey {
        &self.key
    }
}

/// What all selectors found, by method, property and rerun.
#[derive(Default)]
pub(crate) struct Selections(BTreeMap<(String, Property, usize), Found>);

impl Selections {
    pub(crate) fn get(&self, method: &str, property: Property, rerun: usize) -> Option<&Found> {
        self.0.get(&(method.to_owned(), property, rerun))
    }
}

/// What selections are made on.
pub(crate) struct Selecting<'a> {
    pub experiment: &'a Experiment,
    pub encodings: &'a Encodings,
    pub splits: &'a Splits,
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
            for Wanted {
                method,
                property,
                rerun,
                key,
                ..
            } in wanted
            {
                let found = self.journal.get(&key).context("views were not selected")?;
                let key = (method.id.clone(), property, rerun);
                selections.0.insert(key, found.clone());
            }
        }
        Ok(())
    }

    /// Every selection that the methods of a family need, property by property.
    fn wanted<'m>(&self, family: &Family<'m>, reruns: Range<usize>) -> Result<Vec<Wanted<'m>>> {
        let mut wanted = Vec::new();
        for &property in &self.encodings.stage.tables.properties {
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
        TrialKey::of(&Inputs {
            code: env!("SOURCE_HASH"),
            data: self
                .encodings
                .stage
                .tables
                .fingerprint()
                .to_hex()
                .to_string(),
            views: self.encodings.stage.tables.all_views,
            seed: self.experiment.seed,
            folds: self.experiment.selection_folds,
            frozen: family.frozen.map(Head::config),
            selected,
            refit: selected
                .refit
                .as_ref()
                .map(|refit| self.refit_inputs(refit, rerun)),
            property: property.code(),
            rerun,
            training: &self.splits.all[rerun].train,
        })
    }

    /// What a choice by refits depends on beside the training surfaces and the property's own
    /// readings: the properties that it is pooled over, and what hindsight looks at.
    fn refit_inputs(&self, refit: &Refit, rerun: usize) -> RefitInputs {
        let tables = &self.encodings.stage.tables;
        let held_out = || {
            let places: Vec<usize> = (0..tables.views.len()).collect();
            let surfaces = &self.splits.all[rerun].validation;
            self.encodings
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
        let estimators = match family.frozen {
            Some(head) if !missing.is_empty() => Some(self.estimators(head, &missing)?),
            _ => None,
        };
        let mut refits = Refits::new(self.encodings, self.splits, self.experiment.seed);
        let progress = Progress::new("views selected", missing.len());
        let of_trial = |a: &&Wanted<'_>, b: &&Wanted<'_>| a.pair() == b.pair();
        for chunk in missing.chunk_by(of_trial) {
            let search = match &estimators {
                Some(estimators) => Some(self.search(estimators, chunk[0])?),
                None => None,
            };
            for wanted in chunk {
                progress.say(&format!("{}, {}", wanted.method.label, wanted.property));
                let found = match &wanted.selected.refit {
                    Some(refit) => self.refitted(&mut refits, refit, wanted),
                    None => self.select(search.as_ref(), wanted),
                };
                let doing = || format!("method `{}`, {}", wanted.method.id, wanted.property);
                let found = found.with_context(doing)?;
                self.journal.append(vec![found])?;
                progress.advance(1);
            }
        }
        Ok(())
    }

    /// Stage 1: estimators for all properties, reruns and folds of `wanted`, trained on random
    /// sets.
    fn estimators(&self, head: &Head, wanted: &[&Wanted<'_>]) -> Result<TrainedHeads> {
        let folds = 0..self.experiment.selection_folds;
        let pairs = wanted.chunk_by(|a, b| a.pair() == b.pair());
        let trials: Vec<Trial> = pairs
            .flat_map(|pair| folds.clone().map(|fold| self.trial(pair[0], fold)))
            .collect();
        let of_rerun = |rerun| folds.clone().map(move |fold| (rerun, fold));
        let numbered = (0..self.splits.all.len()).flat_map(of_rerun);
        let reruns = numbered.map(|(rerun, fold)| {
            Ok(Rerun {
                number: self.number(rerun, fold),
                training: self.part(rerun, fold)?.train,
                validation: Vec::new(),
            })
        });
        let observer = Trained(Progress::new("estimators for random views", trials.len()));
        let plan = Plan {
            seed: self.experiment.seed,
            reruns: reruns.collect::<Result<_>>()?,
            trials,
        };
        let plan = early_stopped(head, &self.splits.units, plan)?;
        Ok(head.train(&self.training_data(), &plan, &observer)?)
    }

    fn training_data(&self) -> TrainingData<'_> {
        let tables = &self.encodings.stage.tables;
        tables.training_data(&self.splits.units)
    }

    /// What is searched for one property and rerun.
    fn search(&self, estimators: &TrainedHeads, wanted: &Wanted<'_>) -> Result<Frozen> {
        let data = self.training_data();
        let column = data.readings.column(wanted.property.code());
        let read = |&s: &usize| column.is_some_and(|column| data.readings.get(s, column).is_some());
        let mut folds = Vec::new();
        for fold in 0..self.experiment.selection_folds {
            let held = self.part(wanted.rerun, fold)?.validation;
            // A part without a reading says nothing.
            if held.iter().any(read) {
                let trial = self.trial(wanted, fold);
                folds.push(estimators.fusion_loss(&trial, &data, &held)?);
            }
        }
        Ok(Frozen(folds))
    }

    /// The estimator of one fold.
    fn trial(&self, wanted: &Wanted<'_>, fold: usize) -> Trial {
        Trial {
            property: wanted.property.to_string(),
            rerun: self.number(wanted.rerun, fold),
            views: Views::Random,
        }
    }

    /// A number for each rerun and fold.
    fn number(&self, rerun: usize, fold: usize) -> u64 {
        (rerun * self.experiment.selection_folds + fold) as u64
    }

    /// The training surfaces of a rerun that a fold's estimator is trained on, and those that its
    /// loss is measured on. Units stay whole.
    fn part(&self, rerun: usize, fold: usize) -> Result<Split> {
        let (folds, seed) = (self.experiment.selection_folds, self.experiment.seed);
        let parts = self.splits.to_select(rerun, folds, seed)?;
        parts.into_iter().nth(fold).context("no such fold")
    }

    /// The choice by a regression that is fitted anew to each set.
    fn refitted(
        &self,
        refits: &mut Refits<'_>,
        refit: &Refit,
        wanted: &Wanted<'_>,
    ) -> Result<Found> {
        let properties = &self.encodings.stage.tables.properties;
        let place = properties
            .iter()
            .position(|property| *property == wanted.property);
        let place = place.context("a property that is not estimated")?;
        let chosen = refits.select(wanted.selected, refit, place, wanted.rerun)?;
        Ok(Found {
            key: wanted.key.clone(),
            selection: thinned(chosen.selection),
            random_loss: chosen.random_loss,
        })
    }

    /// Stage 2.
    fn select(&self, search: Option<&Frozen>, wanted: &Wanted<'_>) -> Result<Found> {
        let (selected, key) = (wanted.selected, wanted.key.clone());
        let seed = seed(self.experiment.seed, wanted.property.code(), wanted.rerun);
        let Some(frozen) = search else {
            return Ok(Found {
                key,
                selection: without_loss(selected, self.encodings.stage.tables.all_views, seed)?,
                random_loss: None,
            });
        };
        let problem = Problem::new(frozen)?.distinct(selected.distinct).seed(seed);
        let random = Random { draws: RANDOM_SETS }.select(&problem)?;
        let selection = selected.selector.selector().select(&problem);
        Ok(Found {
            key,
            selection: thinned(selection?),
            random_loss: random.curve.first().map(|point| point.mean),
        })
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
    fn pair(&self) -> (Property, usize) {
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

/// The loss of frozen estimators, as selectors ask for it: the mean over the surfaces of all.
struct Frozen(Vec<FusionLoss>);

impl SetLoss for Frozen {
    fn views(&self) -> usize {
        self.0.first().map_or(0, FusionLoss::views)
    }

    fn picks(&self) -> usize {
        self.0.first().map_or(0, FusionLoss::slots)
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        let surfaces: usize = self.0.iter().map(FusionLoss::surfaces).sum();
        let mut of_fold = vec![0.0; losses.len()];
        losses.fill(0.0);
        for fold in &self.0 {
            fold.losses(sets.as_flat(), &mut of_fold)?;
            let share = fold.surfaces() as f64 / surfaces as f64;
            for (sum, loss) in losses.iter_mut().zip(&of_fold) {
                *sum += share * loss;
            }
        }
        Ok(())
    }
}

/// Counts estimators as they are trained.
struct Trained(Progress);

impl Observer for Trained {
    fn finished(&self, heads: &TrainedHeads) {
        self.0.advance(heads.heads().len());
    }
}

/// Points that are kept of a search's curve.
const CURVE_POINTS: usize = 60;

/// The selection with a curve of few points, the last among them.
fn thinned(mut selection: Selection) -> Selection {
    let count = selection.curve.len();
    let keep = |at: usize| at * CURVE_POINTS / count != (at + 1) * CURVE_POINTS / count;
    let mut at = 0..;
    if count > CURVE_POINTS {
        selection.curve.retain(|_| at.next().is_some_and(keep));
    }
    selection
}
