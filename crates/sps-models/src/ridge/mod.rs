//! Ridge regression from embeddings to tactile values: the honest floor under every network.

mod fit;
mod store;

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::data::Embeddings;
use crate::error::{Error, Result};
use crate::heads::{Estimates, Plan, TrainingData, Trial, Views};
use fit::{Axes, Fit};

/// Settings of [`Ridge`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct RidgeConfig {
    /// The penalties to choose from, each in units of the features' mean variance: `l` in
    /// `|y - Xw|² / 2n + l v |w|² / 2`, with `v` the mean variance of a feature.
    pub penalties: Vec<f64>,
}

impl Default for RidgeConfig {
    fn default() -> Self {
        Self {
            penalties: vec![
                0.01, 0.0316, 0.1, 0.316, 1.0, 3.16, 10.0, 31.6, 100.0, 316.0, 1000.0,
            ],
        }
    }
}

/// Ridge regression (Hoerl and Kennard 1970) with the penalty that predicts best when each
/// training surface is left out in turn, as scikit-learn's `RidgeCV`.
///
/// Several views of a surface enter side by side. The fit is linfa's; the features are turned to
/// their principal axes first, which changes nothing but the time it takes.
#[derive(Clone, Debug, PartialEq)]
pub struct Ridge(RidgeConfig);

impl Ridge {
    /// Checks a configuration.
    ///
    /// # Errors
    ///
    /// No penalty, or one that is not above zero.
    pub fn new(config: RidgeConfig) -> Result<Self> {
        let refused =
            |found: String, expected| Err(Error::input("ridge penalties", found, expected));
        if config.penalties.is_empty() {
            return refused("none".into(), "at least one");
        }
        match config
            .penalties
            .iter()
            .find(|&&p| !(p.is_finite() && p > 0.0))
        {
            None => Ok(Self(config)),
            Some(penalty) => refused(penalty.to_string(), "numbers above 0"),
        }
    }

    /// The configuration.
    pub fn config(&self) -> &RidgeConfig {
        &self.0
    }

    /// Fits every trial of the plan, on the threads of the current rayon pool. A trial's fit
    /// depends on its own data alone.
    ///
    /// # Errors
    ///
    /// A plan that does not fit the data, a trial without fixed views, a property without a
    /// training reading.
    pub fn train(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<TrainedRidges> {
        plan.check(None, data)?;
        let mut groups: BTreeMap<(&[usize], Vec<usize>), Vec<Job<'_>>> = BTreeMap::new();
        for (at, trial) in plan.trials.iter().enumerate() {
            let Views::Fixed(views) = &trial.views else {
                return Err(Error::input(
                    "ridge views",
                    "ones that change",
                    "fixed ones",
                ));
            };
            let (surfaces, values) = plan.readings(data, trial).into_iter().unzip();
            let job = Job { at, trial, values };
            groups.entry((views, surfaces)).or_default().push(job);
        }
        let fitted: Vec<Result<Vec<_>>> = groups
            .par_iter()
            .map(|((views, surfaces), jobs)| {
                let axes = Axes::new(&data.embeddings.select(surfaces, views)?)?;
                let fits = jobs.par_iter().map(|job| {
                    let trial = job.trial.clone();
                    let fit = axes.fit(&job.values, &self.0.penalties)?;
                    Ok((job.at, TrainedRidge { trial, fit }))
                });
                fits.collect()
            })
            .collect();
        let mut ridges = fitted.into_iter().collect::<Result<Vec<_>>>()?.concat();
        ridges.sort_by_key(|(at, _)| *at);
        Ok(TrainedRidges {
            ridges: ridges.into_iter().map(|(_, ridge)| ridge).collect(),
        })
    }
}

/// A trial of a plan, with its training values.
struct Job<'a> {
    at: usize,
    trial: &'a Trial,
    values: Vec<f64>,
}

/// One fitted ridge regression.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainedRidge {
    trial: Trial,
    fit: Fit,
}

impl TrainedRidge {
    /// What it was fitted for.
    pub fn trial(&self) -> &Trial {
        &self.trial
    }

    /// The penalty that was chosen, in the units of [`RidgeConfig::penalties`].
    pub fn penalty(&self) -> f64 {
        self.fit.penalty
    }
}

/// Fitted ridge regressions.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainedRidges {
    ridges: Vec<TrainedRidge>,
}

impl TrainedRidges {
    /// The regressions, in the order of the plan.
    pub fn ridges(&self) -> &[TrainedRidge] {
        &self.ridges
    }

    /// The regressions for which `keep` says so.
    #[must_use]
    pub fn filter(&self, keep: impl Fn(&Trial) -> bool) -> Self {
        let kept = self.ridges.iter().filter(|ridge| keep(&ridge.trial));
        Self {
            ridges: kept.cloned().collect(),
        }
    }

    /// Multiply-adds to estimate one surface from its embeddings, all regressions together.
    pub fn multiply_adds(&self) -> u64 {
        let ridges = self.ridges.iter();
        ridges.map(|ridge| ridge.fit.weights.len() as u64).sum()
    }

    /// The estimates of every regression for every surface, in measured units. The views of
    /// `embeddings` are the ones to use, in the order of the trial's views.
    ///
    /// # Errors
    ///
    /// Embeddings of another width or number of views than were fitted.
    pub fn predict(&self, embeddings: &Embeddings) -> Result<Vec<Estimates>> {
        let estimates: Vec<Result<Estimates>> = self
            .ridges
            .par_iter()
            .map(|ridge| {
                Ok(Estimates {
                    property: ridge.trial.property.clone(),
                    rerun: ridge.trial.rerun,
                    values: ridge.fit.predict(embeddings)?,
                })
            })
            .collect();
        estimates.into_iter().collect()
    }
}
