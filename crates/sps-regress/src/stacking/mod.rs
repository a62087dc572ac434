//! Stacked regression: several estimators as one, weighted by what each says of surfaces that it
//! has not seen.

mod store;
mod weights;

use std::collections::{BTreeMap, BTreeSet};

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};
use sps_base::streams::named_stream;

use crate::data::Embeddings;
use crate::error::{Error, Result};
use crate::plan::{Plan, Rerun, TrainingData, Trial, Views};
use crate::regressor::{Estimates, FittedRegressor, Regressor};
pub(crate) use store::MOST_DEPTH;
use weights::nonnegative_least_squares;

/// What fitted stacks are read by.
pub(crate) const KIND: &str = "stacks";

/// The most members: their subsets are tried one by one.
const MOST_MEMBERS: usize = 4;

/// Stacked regression (Wolpert 1992; Breiman 1996). The estimate is
/// `m + sum of w_k (f_k(x) - m)`, with `m` the mean of the training readings and `f_k` the members
/// fitted to all training surfaces. The weights are not below zero and minimise the squared error
/// of the same sum with estimates out of fold, from members that were fitted to other surfaces.
/// Nothing else binds them: where no member helps all are zero, and the estimate is the mean.
pub struct Stacking {
    members: Vec<Box<dyn Regressor>>,
    folds: usize,
}

impl Stacking {
    /// Takes the members, and the number of parts that the training units are dealt into.
    ///
    /// # Errors
    /// No member or more than 4, one that [needs a validation part](Regressor::needs_validation),
    /// as the folds name none; fewer than 2 folds.
    pub fn new(members: Vec<Box<dyn Regressor>>, folds: usize) -> Result<Self> {
        if members.is_empty() || members.len() > MOST_MEMBERS {
            let expected = format_args!("1 to {MOST_MEMBERS}");
            return Err(Error::input("members of a stack", members.len(), expected));
        }
        if members.iter().any(|member| member.needs_validation()) {
            let (what, found) = ("members of a stack", "early stopping");
            let expected = "members that need no validation part, such as no early stopping";
            return Err(Error::input(what, found, expected));
        }
        if folds < 2 {
            return Err(Error::input("folds of a stack", folds, "at least 2"));
        }
        Ok(Self { members, folds })
    }

    /// Fits every trial of the plan: each member to each fold's other surfaces, and to all. A
    /// trial's fit has the bits that it would have alone.
    ///
    /// # Errors
    /// A plan that does not fit the data, a trial without fixed views, a rerun whose number is too
    /// large to number its folds, what the members say.
    pub fn train(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<TrainedStacks> {
        plan.check(None, data)?;
        let folds = Folds::deal(plan, self.folds, data.units)?;
        let inner = folds.plan(data, plan)?;
        let mut out_of_fold = Vec::with_capacity(self.members.len());
        for member in &self.members {
            let fitted = member.fit(data, &inner)?;
            out_of_fold.push(folds.estimates(data, fitted.as_ref())?);
        }
        let stacks = plan.trials.iter().map(|trial| {
            let readings = plan.readings(data, trial);
            TrainedStack::fit(trial, &readings, &out_of_fold, &folds)
        });
        let stacks: Vec<TrainedStack> = stacks.collect();
        let mut members = Vec::with_capacity(self.members.len());
        for (at, member) in self.members.iter().enumerate() {
            let needed = stacks.iter().filter(|stack| stack.weights[at] > 0.0);
            let trials: Vec<Trial> = needed.map(|stack| stack.trial.clone()).collect();
            let plan = Plan {
                trials,
                ..plan.clone()
            };
            members.push(member.fit(data, &plan)?);
        }
        Ok(TrainedStacks { stacks, members })
    }
}

/// The training surfaces of one rerun without one part of them.
struct Fold {
    /// The rerun's own number.
    of: u64,
    /// The number that the fold has as a rerun.
    number: u64,
    training: Vec<usize>,
    held_out: Vec<usize>,
}

struct Folds(Vec<Fold>);

/// Estimates by fold number, views and property, for the surfaces that the fold holds out.
type OutOfFold = BTreeMap<(u64, Views, String), Vec<f64>>;

impl Folds {
    fn deal(plan: &Plan, count: usize, units: Option<&[usize]>) -> Result<Self> {
        let mut folds = Vec::with_capacity(plan.reruns.len() * count);
        for rerun in &plan.reruns {
            let first = rerun.number.checked_mul(count as u64 + 1);
            let fits = first.and_then(|first| first.checked_add(count as u64));
            let (Some(first), Some(_)) = (first, fits) else {
                let what = "number of a rerun";
                return Err(Error::input(what, rerun.number, "a smaller one"));
            };
            let unit = |surface: usize| units.map_or(surface, |units| units[surface]);
            let all: BTreeSet<usize> = rerun.training.iter().map(|&s| unit(s)).collect();
            let mut order: Vec<usize> = all.into_iter().collect();
            order.shuffle(&mut named_stream(plan.seed, "stacking folds", rerun.number));
            let dealt = order.into_iter().enumerate();
            let of_unit: BTreeMap<usize, usize> = dealt.map(|(at, u)| (u, at % count)).collect();
            for fold in 0..count {
                let held = |surface: &usize| of_unit.get(&unit(*surface)) == Some(&fold);
                let (held_out, training) = rerun.training.iter().copied().partition(held);
                folds.push(Fold {
                    of: rerun.number,
                    number: first + fold as u64,
                    training,
                    held_out,
                });
            }
        }
        Ok(Self(folds))
    }

    /// The trials without each part of their surfaces; not those that are left without a reading.
    fn plan(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<Plan> {
        let mut trials = Vec::new();
        for fold in &self.0 {
            for trial in plan.trials.iter().filter(|trial| trial.rerun == fold.of) {
                let Views::Fixed(_) = &trial.views else {
                    let what = "views of a trial";
                    return Err(Error::input(what, "ones that change", "fixed ones"));
                };
                let column = data.readings.column(&trial.property);
                let read = |&s: &usize| column.and_then(|c| data.readings.get(s, c)).is_some();
                if fold.training.iter().any(read) && fold.held_out.iter().any(read) {
                    trials.push(Trial {
                        rerun: fold.number,
                        ..trial.clone()
                    });
                }
            }
        }
        let used = |fold: &&Fold| trials.iter().any(|trial| trial.rerun == fold.number);
        let reruns = self.0.iter().filter(used);
        let reruns = reruns.map(|fold| Rerun::new(fold.number, fold.training.clone()));
        Ok(Plan {
            seed: plan.seed,
            reruns: reruns.collect(),
            trials,
        })
    }

    fn estimates(
        &self,
        data: &TrainingData<'_>,
        fitted: &dyn FittedRegressor,
    ) -> Result<OutOfFold> {
        let mut all = OutOfFold::new();
        for fold in &self.0 {
            let of_fold = fitted.filtered(&|trial| trial.rerun == fold.number);
            let views: BTreeSet<Views> = of_fold.trials().iter().map(|t| t.views.clone()).collect();
            for views in views {
                let Views::Fixed(picked) = &views else {
                    continue;
                };
                let alike = of_fold.filtered(&|trial| trial.views == views);
                let embeddings = data.embeddings.select(&fold.held_out, picked)?;
                for estimates in alike.predict(&embeddings)? {
                    let key = (fold.number, views.clone(), estimates.property);
                    all.insert(key, estimates.values);
                }
            }
        }
        Ok(all)
    }
}

/// The weights of the members for one trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct TrainedStack {
    trial: Trial,
    mean: f64,
    /// Of each member, in the order of [`Stacking::new`].
    weights: Vec<f64>,
}

impl TrainedStack {
    fn fit(trial: &Trial, readings: &[(usize, f64)], members: &[OutOfFold], folds: &Folds) -> Self {
        let sum: f64 = readings.iter().map(|(_, value)| value).sum();
        let mean = sum / readings.len().max(1) as f64;
        let readings: BTreeMap<usize, f64> = readings.iter().copied().collect();
        let mut columns = vec![Vec::new(); members.len()];
        let mut target = Vec::new();
        for fold in folds.0.iter().filter(|fold| fold.of == trial.rerun) {
            let key = (fold.number, trial.views.clone(), trial.property.clone());
            let estimates: Vec<_> = members.iter().filter_map(|m| m.get(&key)).collect();
            if estimates.len() < members.len() {
                continue;
            }
            for (at, surface) in fold.held_out.iter().enumerate() {
                let Some(value) = readings.get(surface) else {
                    continue;
                };
                target.push(value - mean);
                for (column, estimates) in columns.iter_mut().zip(&estimates) {
                    column.push(estimates[at] - mean);
                }
            }
        }
        Self {
            trial: trial.clone(),
            mean,
            weights: nonnegative_least_squares(&columns, &target),
        }
    }
}

/// Fitted stacks.
pub struct TrainedStacks {
    stacks: Vec<TrainedStack>,
    /// Each fitted to the trials in which it has a weight.
    members: Vec<Box<dyn FittedRegressor>>,
}

impl FittedRegressor for TrainedStacks {
    fn trials(&self) -> Vec<&Trial> {
        self.stacks.iter().map(|stack| &stack.trial).collect()
    }

    fn predict(&self, embeddings: &Embeddings) -> Result<Vec<Estimates>> {
        let estimates = |stack: &TrainedStack| Estimates {
            property: stack.trial.property.clone(),
            rerun: stack.trial.rerun,
            values: vec![stack.mean; embeddings.surfaces()],
        };
        let mut all: Vec<Estimates> = self.stacks.iter().map(estimates).collect();
        for (at, member) in self.members.iter().enumerate() {
            let of_member = member.predict(embeddings)?;
            for (trial, estimates) in member.trials().into_iter().zip(of_member) {
                let stacks = self.stacks.iter().zip(&mut all);
                for (stack, sums) in stacks.filter(|(stack, _)| stack.trial == *trial) {
                    for (sum, value) in sums.values.iter_mut().zip(&estimates.values) {
                        *sum += stack.weights[at] * (value - stack.mean);
                    }
                }
            }
        }
        Ok(all)
    }

    fn filtered(&self, keep: &dyn Fn(&Trial) -> bool) -> Box<dyn FittedRegressor> {
        let kept = self.stacks.iter().filter(|stack| keep(&stack.trial));
        Box::new(Self {
            stacks: kept.cloned().collect(),
            members: self.members.iter().map(|m| m.filtered(keep)).collect(),
        })
    }

    fn multiply_adds(&self) -> u64 {
        let weighted = self.stacks.iter().flat_map(|stack| &stack.weights);
        let weighted = weighted.filter(|&&weight| weight > 0.0).count() as u64;
        let members = self.members.iter().map(|member| member.multiply_adds());
        weighted + members.sum::<u64>()
    }

    fn kind(&self) -> &'static str {
        KIND
    }

    fn to_bytes(&self) -> Result<Vec<u8>> {
        store::to_bytes(self)
    }
}

impl Regressor for Stacking {
    fn fit(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<Box<dyn FittedRegressor>> {
        Ok(Box::new(self.train(data, plan)?))
    }
}
