//! The loss of a set of views for kernel ridge regression that is fitted anew to each set: of all
//! properties at once, on the training surfaces or, in hindsight, on those held out.

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail};
use sps_dataset::{Property, Split, Units};
use sps_metrics::{Samples, TrainingMean};
use sps_regress::kernel_ridge::{KernelRidge, SetLosses};
use sps_regress::{FittedRegressor, Trial, Views};
use sps_viewselect::{LossError, Pooled, Problem, Remembered, Selector, Sets, SharedLoss};

use super::found::Found;
use super::trials::plan;
use super::views::seed;
use super::{Encodings, Splits};
use crate::config::{JudgedOn, Refit, Selected};
use crate::journal::TrialKey;

/// Random sets whose mean loss stands for that of a random set.
const RANDOM_SETS: usize = 100;

/// How far the loss of a property may be drawn towards that of all.
const AMOUNTS: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// The losses of sets of views: each set is fitted once, whichever method and property asks.
pub(super) struct Refits<'a> {
    encodings: &'a Encodings,
    splits: &'a Splits,
    seed: u64,
    /// By rerun and regression, number of views, and whom they are judged on.
    losses: BTreeMap<String, Remembered<Loss<'a>>>,
    /// How far the losses of a selector are drawn together, by rerun and selector.
    amounts: BTreeMap<String, f64>,
}

impl<'a> Refits<'a> {
    pub(super) fn new(encodings: &'a Encodings, splits: &'a Splits, seed: u64) -> Self {
        Self {
            encodings,
            splits,
            seed,
            losses: BTreeMap::new(),
            amounts: BTreeMap::new(),
        }
    }

    /// Chooses views for a property in a rerun.
    pub(super) fn select(
        &mut self,
        key: TrialKey,
        selected: &Selected,
        refit: &Refit,
        (property, rerun): (&Property, usize),
    ) -> Result<Found> {
        let properties = &self.encodings.stage.tables.properties;
        let place = properties.iter().position(|other| other == property);
        let place = place.context("a property that is not estimated")?;
        let amount = self.amount(selected, refit, rerun)?;
        let draws = seed(self.seed, "refit", rerun);
        let pooled = Pooled::new(self.loss(selected, refit, rerun)?, place, amount)?;
        let problem = Problem::new(&pooled)?
            .distinct(selected.distinct)
            .seed(draws);
        Found::search(key, selected, &problem, RANDOM_SETS)
    }

    fn loss(
        &mut self,
        selected: &Selected,
        refit: &Refit,
        rerun: usize,
    ) -> Result<&Remembered<Loss<'a>>> {
        let settings = (rerun, refit.ridge.config(), refit.judged_on, selected.picks);
        let name = serde_json::to_string(&settings)?;
        if !self.losses.contains_key(&name) {
            let split = &self.splits.all[rerun];
            let loss = match refit.judged_on {
                JudgedOn::Training => self.left_out(selected, refit, &split.train)?,
                JudgedOn::HeldOut => {
                    let (encodings, units) = (self.encodings, &self.splits.units);
                    let ridge = refit.ridge.clone();
                    let losses =
                        move |set: &[usize]| in_hindsight(encodings, split, units, &ridge, set);
                    self.judged_by(selected, losses)
                }
            };
            self.losses.insert(name.clone(), loss);
        }
        self.losses.get(&name).context("a loss that was prepared")
    }

    /// Judged by the training surfaces, each left out in turn.
    fn left_out(
        &self,
        selected: &Selected,
        refit: &Refit,
        training: &[usize],
    ) -> Result<Remembered<Loss<'a>>> {
        let tables = &self.encodings.stage.tables;
        let data = tables.training_data(&self.splits.units);
        let losses = SetLosses::new(&data, &tables.codes(), training, refit.ridge.config())?;
        Ok(self.judged_by(selected, move |set| Ok(losses.losses(set)?)))
    }

    fn judged_by(
        &self,
        selected: &Selected,
        of_set: impl Fn(&[usize]) -> Result<Vec<f64>> + Sync + 'a,
    ) -> Remembered<Loss<'a>> {
        let tables = &self.encodings.stage.tables;
        Remembered::new(Loss {
            of_set: Box::new(of_set),
            views: tables.views.len(),
            picks: selected.picks,
            properties: tables.properties.len(),
        })
    }

    /// How far the losses are drawn together: as asked, or as far as pays.
    fn amount(&mut self, selected: &Selected, refit: &Refit, rerun: usize) -> Result<f64> {
        if let Some(amount) = refit.pooled {
            return Ok(amount);
        }
        let name = serde_json::to_string(&(rerun, selected))?;
        if let Some(&amount) = self.amounts.get(&name) {
            return Ok(amount);
        }
        let amount = self.best_amount(selected, refit, rerun)?;
        self.amounts.insert(name, amount);
        Ok(amount)
    }

    /// The amount whose choices on one half of the training surfaces have the least loss on the
    /// other; units stay whole.
    fn best_amount(&self, selected: &Selected, refit: &Refit, rerun: usize) -> Result<f64> {
        let halves = self.splits.to_select(rerun, 2, self.seed)?;
        let loss = |half: &Split| self.left_out(selected, refit, &half.validation);
        let halves = halves.iter().map(loss).collect::<Result<Vec<_>>>()?;
        let [one, other] = halves.as_slice() else {
            bail!("two halves are needed");
        };
        let mut best = (f64::INFINITY, 1.0);
        for amount in AMOUNTS {
            let sum =
                crossed(selected, one, other, amount)? + crossed(selected, other, one, amount)?;
            // Of equal ones the one that is drawn together most.
            if sum <= best.0 {
                best = (sum, amount);
            }
        }
        Ok(best.1)
    }
}

/// The sum of the properties' losses by `judge`, each of the set that `chooser` chooses for it.
fn crossed(
    selected: &Selected,
    chooser: &Remembered<Loss<'_>>,
    judge: &Remembered<Loss<'_>>,
    amount: f64,
) -> Result<f64> {
    let properties = judge.properties();
    let mut losses = vec![0.0; properties];
    let mut sum = 0.0;
    for property in 0..properties {
        let pooled = Pooled::new(chooser, property, amount)?;
        let problem = Problem::new(&pooled)?.distinct(selected.distinct);
        let picks = selected.selector.select(&problem)?.picks;
        let judged = judge.losses(Sets::new(&picks, picks.len())?, &mut losses);
        judged.map_err(|error| anyhow::anyhow!(error))?;
        sum += losses[property];
    }
    Ok(sum)
}

type OfSet<'a> = Box<dyn Fn(&[usize]) -> Result<Vec<f64>> + Sync + 'a>;

/// The loss of a set for each property, in units of the variance of its readings.
struct Loss<'a> {
    of_set: OfSet<'a>,
    views: usize,
    picks: usize,
    properties: usize,
}

impl SharedLoss for Loss<'_> {
    fn views(&self) -> usize {
        self.views
    }

    fn picks(&self) -> usize {
        self.picks
    }

    fn properties(&self) -> usize {
        self.properties
    }

    fn ordered(&self) -> bool {
        false
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        for (set, losses) in sets.iter().zip(losses.chunks_exact_mut(self.properties)) {
            losses.copy_from_slice(&(self.of_set)(set)?);
        }
        Ok(())
    }
}

/// The losses of a set on the surfaces held out: what no selector may look at, to say what was there to be had.
fn in_hindsight(
    encodings: &Encodings,
    split: &Split,
    units: &Units,
    ridge: &KernelRidge,
    set: &[usize],
) -> Result<Vec<f64>> {
    let tables = &encodings.stage.tables;
    let trials = tables.codes().into_iter().map(|property| Trial {
        property,
        rerun: 0,
        views: Views::Fixed(set.to_vec()),
    });
    let plan = plan(0, std::slice::from_ref(split), trials);
    let fitted = ridge.train(&tables.training_data(units), &plan)?;
    let held_out = &split.validation;
    let estimates = fitted.predict(&encodings.select(held_out, set)?)?;
    let losses = estimates.iter().map(|estimates| {
        let reading = |&surface: &usize| tables.reading(&estimates.property, surface);
        let training: Vec<f64> = split.train.iter().filter_map(reading).collect();
        let estimated = held_out.iter().zip(&estimates.values);
        let read = estimated.filter_map(|(surface, estimate)| Some((reading(surface)?, *estimate)));
        let (truth, estimate): (Vec<f64>, Vec<f64>) = read.unzip();
        let samples = Samples {
            truth: &truth,
            estimate: &estimate,
        };
        let r2 = samples.r2(TrainingMean::of(&training)?);
        // Readings that do not differ from the mean say nothing of the set.
        Ok(r2.map_or(0.0, |r2| 1.0 - r2.value))
    });
    losses.collect()
}
