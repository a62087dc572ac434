//! The turns of a method: which models it needs, and passes over a few surfaces.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::Result;
use sps_dataset::{Source, Split};
use sps_models::heads::HeadConfig;
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::{FittedRegressor, Plan};

use super::estimate::{Look, Spent, costs, estimate, timed};
use crate::config::Method;
use crate::journal::Stop;
use crate::results::Costs;
use crate::run::fit::fit_some;
use crate::run::results::MethodRow;
use crate::run::trials::{TrialSpec, plan};
use crate::run::views::TrialViews;
use crate::run::{Splits, Stage};

/// Surfaces that the costs are measured on, all groups of properties together.
const SURFACES: usize = 8;
/// Surfaces that they are measured on at least in each group.
const FEWEST: usize = 2;
/// Seconds after which a method is estimated no more.
const ENOUGH_SECONDS: f64 = 1.0;

pub(super) struct Turn<'a> {
    source: &'a dyn Source,
    stage: &'a Stage,
    surfaces: Vec<usize>,
    /// The looks at a surface: one alone for properties that look at the same views, or one for each view.
    ways: Vec<Vec<Look>>,
    /// The share of estimates that end after each look.
    ends: Vec<f64>,
    /// What had been spent after each look of each estimate.
    estimates: Vec<Vec<Spent>>,
    seconds: f64,
}

impl<'a> Turn<'a> {
    pub(super) fn new(
        source: &'a dyn Source,
        splits: &Splits,
        stage: &'a Stage,
        row: &MethodRow<'_>,
    ) -> Result<Self> {
        let split = &splits.all[0];
        let few = Split {
            train: split.train.iter().copied().take(2 * SURFACES).collect(),
            validation: split.validation.iter().copied().take(SURFACES).collect(),
        };
        let fitting = Fitting {
            stage,
            method: quick(row.method)?,
            splits,
            few: &few,
        };
        let mut surfaces = few.validation.clone();
        let trials = fitting.trials(&row.trials);
        let (ways, ends) = match trials.first() {
            Some(trial) if row.method.adaptive.is_some() => {
                let order = trial.views.shown();
                let looks = (0..order.len()).map(|at| fitting.one_more(trial, &order[..=at]));
                let looks = looks.collect::<Result<Vec<Look>>>()?;
                (vec![looks], shares(row, order.len()))
            }
            _ => {
                let ways = fitting.together(&trials)?;
                surfaces.truncate((SURFACES / ways.len().max(1)).max(FEWEST));
                (ways, vec![1.0])
            }
        };
        Ok(Self {
            source,
            stage,
            surfaces,
            ways,
            ends,
            estimates: Vec::new(),
            seconds: 0.0,
        })
    }

    /// One more pass, unless there have been enough.
    pub(super) fn take(&mut self) -> Result<()> {
        if self.seconds < ENOUGH_SECONDS {
            let (estimates, seconds) = timed(|| self.pass())?;
            self.estimates.extend(estimates);
            self.seconds += seconds;
        }
        Ok(())
    }

    /// Each surface estimated once: what had been spent after each look.
    pub(super) fn pass(&self) -> Result<Vec<Vec<Spent>>> {
        let mut all = Vec::new();
        for looks in &self.ways {
            for &surface in &self.surfaces {
                all.push(estimate(self.source, self.stage, looks, surface)?);
            }
        }
        Ok(all)
    }

    pub(super) fn costs(&self) -> Costs {
        let ends = self.ends.iter().enumerate();
        let weighed = ends.filter(|(_, share)| **share > 0.0).map(|(at, &share)| {
            let spent: Vec<Spent> = self.estimates.iter().map(|steps| steps[at]).collect();
            (share, costs(&spent, self.stage.encoder_bytes))
        });
        Costs::weighed(&weighed.collect::<Vec<_>>())
    }
}

/// The share of estimates that ended at each number of views.
fn shares(row: &MethodRow<'_>, most: usize) -> Vec<f64> {
    let outcomes = row.outcomes.values().flatten();
    let stops: Vec<&Stop> = outcomes.flat_map(|outcome| &outcome.stops).collect();
    let at = |views| stops.iter().filter(|stop| stop.views == views).count();
    let shares = (1..=most).map(|views| at(views) as f64 / stops.len().max(1) as f64);
    shares.collect()
}

/// The method, trained for one epoch.
fn quick(method: &Method) -> Result<Method> {
    let quick = |config: &HeadConfig| HeadConfig {
        epochs: 1,
        ..config.clone()
    };
    let mut method = method.clone();
    let estimator = method.estimator.with(|fitted| fitted.with_heads(&quick));
    method.estimator = estimator?;
    Ok(method)
}

struct Fitting<'a> {
    stage: &'a Stage,
    method: Method,
    splits: &'a Splits,
    few: &'a Split,
}

impl Fitting<'_> {
    /// The trials of the first rerun whose property was measured on any of the few surfaces.
    fn trials<'t>(&self, all: &'t [TrialSpec]) -> Vec<&'t TrialSpec> {
        let tables = &self.stage.tables;
        let measured = |trial: &&TrialSpec| {
            trial.rerun == 0 && !tables.measured(&trial.property, &self.few.train).is_empty()
        };
        all.iter().filter(measured).collect()
    }

    /// A look for the trials that look at the same views.
    fn together(&self, trials: &[&TrialSpec]) -> Result<Vec<Vec<Look>>> {
        let mut groups: BTreeMap<&[Vec<usize>], Vec<&TrialSpec>> = BTreeMap::new();
        for trial in trials {
            let group = groups.entry(&trial.views.fillings).or_default();
            group.push(trial);
        }
        let looks = groups.into_iter().map(|(fillings, trials)| {
            let views: BTreeSet<usize> = fillings.iter().flatten().copied().collect();
            let views: Vec<usize> = views.into_iter().collect();
            let places = fillings.iter().map(|filling| {
                let place = |view: &usize| views.binary_search(view).ok();
                filling.iter().filter_map(place).collect()
            });
            Ok(vec![Look {
                models: vec![self.model(&self.method, trials.into_iter())?],
                fillings: places.collect(),
                views,
            }])
        });
        looks.collect()
    }

    /// The last of these views, after which an estimator is asked, a regression of its errors, and an
    /// estimator of all surfaces.
    fn one_more(&self, trial: &TrialSpec, views: &[usize]) -> Result<Look> {
        let trial = TrialSpec {
            views: TrialViews::fixed(views.to_vec()),
            ..trial.clone()
        };
        let method = self.method.with_views(views.len())?;
        let errors = Ridge::new(RidgeConfig::default())?;
        let data = self.stage.tables.training_data(&self.splits.units);
        let errors = errors.train(&data, &self.plan([&trial].into_iter()))?;
        let estimator = || self.model(&method, [&trial].into_iter());
        Ok(Look {
            views: views.last().copied().into_iter().collect(),
            models: vec![estimator()?, Box::new(errors), estimator()?],
            fillings: vec![(0..views.len()).collect()],
        })
    }

    fn model<'t>(
        &self,
        method: &Method,
        trials: impl Iterator<Item = &'t TrialSpec>,
    ) -> Result<Box<dyn FittedRegressor>> {
        let data = (&self.stage.tables, &self.splits.units);
        fit_some(method, data, &self.plan(trials), &())
    }

    fn plan<'t>(&self, trials: impl Iterator<Item = &'t TrialSpec>) -> Plan {
        let few = std::slice::from_ref(self.few);
        plan(0, few, trials.map(TrialSpec::trial))
    }
}
