//! Choosing views: an estimator is trained on random sets of views and frozen, and selectors search
//! for the set of lowest loss on the training part (section "Viewpoint Selector Framework" of the
//! paper, stages 1 and 2). Stage 3, training with the found set, is a trial like any other.

use std::collections::BTreeMap;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use serde::Serialize;
use sps_dataset::Property;
use sps_models::heads::Head;
use sps_viewselect::Problem;

use super::deal::Dealt;
use super::found::{Found, Selections};
use super::frozen::{Folds, FrozenLoss};
use super::refit::Refits;
use super::views::{seed, without_loss};
use crate::config::{JudgedOn, Method, Selected};
use crate::journal::{Journal, TrialKey};
use crate::progress::{Progress, ensure_wanted};

/// Random sets whose mean loss stands for that of a random set.
const RANDOM_SETS: usize = 2000;

impl Folds<'_> {
    /// Selects views for those of the methods that want some, in the reruns that are dealt of them.
    pub(crate) fn select(
        &self,
        methods: &[&Method],
        dealt: &Dealt,
        journal: &mut Journal<Found>,
        selections: &mut Selections,
    ) -> Result<()> {
        let families = families(methods)?;
        for family in families.values() {
            let wanted = self.wanted(family, dealt)?;
            self.run_missing(family, &wanted, journal)?;
        }
        let lacking = self.look(methods, dealt, journal, selections)?;
        ensure!(lacking.is_empty(), "views were not selected");
        Ok(())
    }

    /// Adds what was selected before; the method, by its place, and rerun of each selection that was
    /// not.
    pub(crate) fn look(
        &self,
        methods: &[&Method],
        dealt: &Dealt,
        journal: &Journal<Found>,
        selections: &mut Selections,
    ) -> Result<Vec<(usize, usize)>> {
        let mut lacking = Vec::new();
        for family in families(methods)?.values() {
            for one in self.wanted(family, dealt)? {
                match journal.get(&one.key) {
                    Some(found) => {
                        let found = found.clone();
                        selections.insert(&one.method.id, one.property, one.rerun, found);
                    }
                    None => lacking.push((one.place, one.rerun)),
                }
            }
        }
        Ok(lacking)
    }

    /// Every selection that the methods of a family need, rerun by rerun: the first selection of a
    /// rerun takes the longest, so the time left is best told when they are spread out.
    fn wanted<'m>(&self, family: &Family<'m>, dealt: &Dealt) -> Result<Vec<Wanted<'m>>> {
        let mut wanted = Vec::new();
        for rerun in dealt.of_any() {
            for property in &self.tables().properties {
                let members = family.members.iter();
                for &(place, method, selected) in members.filter(|one| dealt.has(one.0, rerun)) {
                    wanted.push(Wanted {
                        place,
                        method,
                        selected,
                        property: property.clone(),
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
        property: &Property,
        rerun: usize,
    ) -> Result<TrialKey> {
        let (tables, split) = (self.tables(), &self.splits.all[rerun]);
        let held_out = || {
            let places: Vec<usize> = (0..tables.views.len()).collect();
            let hash = self.encodings.fingerprint(&places, &split.validation);
            hash.to_hex().to_string()
        };
        let refit = selected.refit.as_ref().map(|refit| RefitInputs {
            properties: tables.codes(),
            held_out: (refit.judged_on == JudgedOn::HeldOut).then(held_out),
        });
        TrialKey::of(&Inputs {
            code: env!("SOURCE_HASH"),
            data: tables.fingerprint().to_hex().to_string(),
            views: tables.all_views,
            seed: self.experiment.seed,
            folds: self.experiment.selection_folds,
            frozen: family.frozen.map(Head::config),
            selected,
            refit,
            property: property.code(),
            rerun,
            training: &split.train,
        })
    }

    fn run_missing(
        &self,
        family: &Family<'_>,
        wanted: &[Wanted<'_>],
        journal: &mut Journal<Found>,
    ) -> Result<()> {
        let is_missing = |wanted: &&Wanted<'_>| journal.get(&wanted.key).is_none();
        let missing: Vec<&Wanted<'_>> = wanted.iter().filter(is_missing).collect();
        if let Some(one) = missing.first() {
            let (id, property, rerun) = (&one.method.id, &one.property, one.rerun);
            let what = format!("the views of method `{id}`, {property}, rerun {rerun}");
            self.experiment.work.ensure_fits(&what)?;
        }
        let same_trial = |a: &&Wanted<'_>, b: &&Wanted<'_>| a.trial() == b.trial();
        let asking = missing.iter().copied();
        let asking: Vec<&Wanted<'_>> = asking.filter(|wanted| wanted.asks_frozen()).collect();
        let begun = Instant::now();
        let estimators = match family.frozen {
            Some(head) if !asking.is_empty() => {
                let trials = asking.chunk_by(same_trial).map(|chunk| chunk[0].trial());
                Some(self.train(head, trials)?)
            }
            _ => None,
        };
        let training = begun.elapsed().as_secs_f64() / asking.len().max(1) as f64;
        let mut refits = Refits::new(self.encodings, self.splits, self.experiment.seed);
        let progress = Progress::new("views selected", missing.len());
        for chunk in missing.chunk_by(same_trial) {
            let trial @ (property, rerun) = chunk[0].trial();
            let loss = match &estimators {
                Some(estimators) if chunk.iter().any(|wanted| wanted.asks_frozen()) => {
                    Some(self.loss(estimators, property, rerun)?)
                }
                _ => None,
            };
            for wanted in chunk {
                progress.say(&format!("{}, {}", wanted.method.label, wanted.property));
                let begun = Instant::now();
                let found = match &wanted.selected.refit {
                    Some(refit) => refits.select(wanted.key.clone(), wanted.selected, refit, trial),
                    None => self.search(loss.as_ref(), wanted),
                };
                let doing = || format!("method `{}`, {}", wanted.method.id, wanted.property);
                let mut found = found.with_context(doing)?;
                found.seconds = begun.elapsed().as_secs_f64();
                if wanted.asks_frozen() {
                    found.seconds += training;
                }
                journal.append(vec![found])?;
                progress.advance(1);
                ensure_wanted()?;
            }
        }
        Ok(())
    }

    /// Stage 2.
    fn search(&self, loss: Option<&FrozenLoss>, wanted: &Wanted<'_>) -> Result<Found> {
        let (selected, key) = (wanted.selected, wanted.key.clone());
        let seed = seed(self.experiment.seed, wanted.property.code(), wanted.rerun);
        let Some(loss) = loss else {
            return Ok(Found {
                key,
                selection: without_loss(selected, self.tables().all_views, seed)?,
                random_loss: None,
                seconds: 0.0,
            });
        };
        let problem = Problem::new(loss)?.distinct(selected.distinct).seed(seed);
        Found::search(key, selected, &problem, RANDOM_SETS)
    }
}

/// Methods that share an estimator to search.
#[derive(Default)]
struct Family<'m> {
    /// The estimator, where any of the methods searches it.
    frozen: Option<&'m Head>,
    /// With the place of each among the methods.
    members: Vec<(usize, &'m Method, &'m Selected)>,
}

/// Of methods with one encoder, given by their places among all: those together that select views by
/// the same frozen networks, or by the same refits, and each other alone.
pub(super) fn asks_together(methods: &[Method], members: &[usize]) -> Result<Vec<Vec<usize>>> {
    let some: Vec<&Method> = members.iter().map(|&at| &methods[at]).collect();
    let mut together: Vec<Vec<usize>> = Vec::new();
    for family in families(&some)?.into_values() {
        let places = |refits: bool| {
            let some = family.members.iter();
            let some = some.filter(|(_, _, selected)| selected.refit.is_some() == refits);
            some.map(|&(place, ..)| members[place]).collect()
        };
        together.push(places(true));
        if family.frozen.is_some() {
            together.push(places(false));
        }
    }
    for &at in members {
        if !together.iter().any(|some| some.contains(&at)) {
            together.push(vec![at]);
        }
    }
    together.retain(|some| !some.is_empty());
    // In the order in which their first methods come.
    together.sort();
    Ok(together)
}

fn families<'m>(methods: &[&'m Method]) -> Result<BTreeMap<String, Family<'m>>> {
    let mut families: BTreeMap<String, Family<'_>> = BTreeMap::new();
    for (place, &method) in methods.iter().enumerate() {
        let Some(selected) = method.selected() else {
            continue;
        };
        let head = method.estimator.head();
        let name = serde_json::to_string(&head.map(Head::config))?;
        let family = families.entry(name).or_default();
        if selected.selector.learns() && selected.refit.is_none() {
            family.frozen = head;
        }
        family.members.push((place, method, selected));
    }
    Ok(families)
}

struct Wanted<'m> {
    /// Of the method among all.
    place: usize,
    method: &'m Method,
    selected: &'m Selected,
    property: Property,
    rerun: usize,
    key: TrialKey,
}

impl Wanted<'_> {
    fn trial(&self) -> (&Property, usize) {
        (&self.property, self.rerun)
    }

    /// Whether it asks the family's frozen network, if there is one.
    fn asks_frozen(&self) -> bool {
        self.selected.refit.is_none()
    }
}

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

/// What a choice by refits depends on beside the training surfaces and the property's own readings: the
/// properties that it is pooled over, and what hindsight looks at.
#[derive(Serialize)]
struct RefitInputs {
    properties: Vec<String>,
    held_out: Option<String>,
}
