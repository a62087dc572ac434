//! The turns of a method: which models it needs, and passes over a few surfaces.

use std::collections::BTreeMap;

use anyhow::Result;
use sps_dataset::{Source, Split};
use sps_models::heads::HeadConfig;
use sps_regress::FittedRegressor;
use sps_regress::ridge::{Ridge, RidgeConfig};

use super::estimate::{Estimating, Spent, costs, timed};
use crate::config::Method;
use crate::journal::Stop;
use crate::results::Costs;
use crate::run::encoded::Finished;
use crate::run::fit::fit_some;
use crate::run::trials::{TrialSpec, plan};
use crate::run::views::TrialViews;
use crate::run::{Splits, Stage};

/// Surfaces that the costs are measured on, all groups of properties together.
const SURFACES: usize = 8;
/// Surfaces that they are measured on at least in each group.
const FEWEST: usize = 2;
/// Seconds after which a method is estimated no more.
const ENOUGH_SECONDS: f64 = 1.0;

/// A method whose costs are measured.
pub(super) struct Turn<'a, S> {
    estimating: Estimating<'a, S>,
    surfaces: Vec<usize>,
    way: Way,
    /// The share of estimates that end after each step.
    ends: Vec<f64>,
    /// What had been spent after each step of each estimate.
    estimates: Vec<Vec<Spent>>,
    seconds: f64,
}

/// The fillings of slots with views, and the models of properties that look at them.
type Group = (Vec<Vec<usize>>, Box<dyn FittedRegressor>);

/// How a method looks at its views.
enum Way {
    /// At once: the models of properties that look at the same views, with these.
    Together(Vec<Group>),
    /// One after the other, in this order: for each number of views an estimator, and a regression
    /// of its errors.
    OneByOne(Vec<usize>, Vec<[Box<dyn FittedRegressor>; 2]>),
}

impl<'a, S: Source> Turn<'a, S> {
    pub(super) fn new(
        source: &'a S,
        splits: &Splits,
        stage: &'a Stage,
        finished: &Finished<'_>,
    ) -> Result<Self> {
        let split = &splits.all[0];
        let few = Split {
            train: split.train.iter().copied().take(2 * SURFACES).collect(),
            validation: split.validation.iter().copied().take(SURFACES).collect(),
        };
        let fitting = Fitting {
            stage,
            method: quick(finished.method)?,
            splits,
            few: &few,
        };
        let mut surfaces = few.validation.clone();
        let trials = fitting.trials(&finished.trials);
        let (way, ends) = match trials.first() {
            Some(trial) if finished.method.adaptive.is_some() => {
                let order = trial.views.shown();
                let models = (1..=order.len()).map(|views| fitting.models(trial, &order[..views]));
                let models = models.collect::<Result<_>>()?;
                let ends = shares(&finished.stops, order.len());
                (Way::OneByOne(order, models), ends)
            }
            _ => {
                let groups = fitting.groups(&trials)?;
                surfaces.truncate((SURFACES / groups.len().max(1)).max(FEWEST));
                (Way::Together(groups), vec![1.0])
            }
        };
        Ok(Self {
            estimating: Estimating { source, stage },
            surfaces,
            way,
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

    /// Each surface estimated once: what had been spent after each step.
    pub(super) fn pass(&self) -> Result<Vec<Vec<Spent>>> {
        let mut all = Vec::new();
        match &self.way {
            Way::Together(groups) => {
                for (fillings, model) in groups {
                    for &surface in &self.surfaces {
                        all.push(vec![self.estimating.estimate(
                            model.as_ref(),
                            fillings,
                            surface,
                        )?]);
                    }
                }
            }
            Way::OneByOne(order, models) => {
                for &surface in &self.surfaces {
                    all.push(self.estimating.walk(models, order, surface)?);
                }
            }
        }
        Ok(all)
    }

    pub(super) fn costs(&self) -> Costs {
        let ends = self.ends.iter().enumerate();
        let weighed = ends.filter(|(_, share)| **share > 0.0).map(|(at, &share)| {
            let spent: Vec<Spent> = self.estimates.iter().map(|steps| steps[at]).collect();
            (share, costs(&spent, self.estimating.stage.encoder_bytes))
        });
        Costs::weighed(&weighed.collect::<Vec<_>>())
    }
}

/// The share of `stops` at each number of views.
fn shares(stops: &[Stop], most: usize) -> Vec<f64> {
    let at = |views| stops.iter().filter(|stop| stop.views == views).count();
    let shares = (1..=most).map(|views| at(views) as f64 / stops.len().max(1) as f64);
    shares.collect()
}

/// The method, trained for one epoch.
fn quick(method: &Method) -> Result<Method> {
    let mut method = method.clone();
    method.estimator = method.estimator.with_heads(&|config| HeadConfig {
        epochs: 1,
        ..config.clone()
    })?;
    Ok(method)
}

/// Models of a method's shape, fitted to a few surfaces.
struct Fitting<'a> {
    stage: &'a Stage,
    method: Method,
    splits: &'a Splits,
    few: &'a Split,
}

impl Fitting<'_> {
    /// The trials of the first rerun whose property was measured on any of the few surfaces.
    fn trials<'t>(&self, all: &'t [TrialSpec]) -> Vec<&'t TrialSpec> {
        let readings = &self.stage.tables.readings;
        let measured = |trial: &&TrialSpec| {
            let column = readings.column(trial.property.code());
            let reading = |&s: &usize| readings.get(s, column?);
            trial.rerun == 0 && self.few.train.iter().any(|s| reading(s).is_some())
        };
        all.iter().filter(measured).collect()
    }

    /// Models of the trials that look at the same views, with these.
    fn groups(&self, trials: &[&TrialSpec]) -> Result<Vec<Group>> {
        let mut groups: BTreeMap<&[Vec<usize>], Vec<&TrialSpec>> = BTreeMap::new();
        for trial in trials {
            let group = groups.entry(&trial.views.fillings).or_default();
            group.push(trial);
        }
        let fitted = groups.into_iter().map(|(fillings, trials)| {
            let plan = plan(0, std::slice::from_ref(self.few), trials.into_iter());
            let data = (&self.stage.tables, &self.splits.units);
            let model = fit_some(&self.method, data, &plan, &())?;
            Ok((fillings.to_vec(), model))
        });
        fitted.collect()
    }

    /// The estimator of some views, and the regression of its errors.
    fn models(&self, trial: &TrialSpec, views: &[usize]) -> Result<[Box<dyn FittedRegressor>; 2]> {
        let trial = TrialSpec {
            views: TrialViews::fixed(views.to_vec()),
            ..trial.clone()
        };
        let plan = plan(0, std::slice::from_ref(self.few), [&trial].into_iter());
        let (tables, units) = (&self.stage.tables, &self.splits.units);
        let method = self.method.with_views(views.len())?;
        let errors = Ridge::new(RidgeConfig::default())?;
        let errors = errors.train(&tables.training_data(units), &plan)?;
        let estimator = fit_some(&method, (tables, units), &plan, &())?;
        Ok([estimator, Box::new(errors)])
    }
}
