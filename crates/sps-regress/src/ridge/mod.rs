//! Ridge regression from embeddings to tactile values: the honest floor under every network.
//!
//! ```
//! use sps_regress::ridge::{Ridge, RidgeConfig};
//! use sps_regress::{Embeddings, Plan, Readings, Rerun, TrainingData};
//!
//! // One feature, and a reading that is a line in it.
//! let embeddings = Embeddings::new(vec![1.0, 2.0, 3.0, 4.0, 5.0], [5, 1, 1])?;
//! let rows: Vec<_> = (1..6).map(|surface| vec![Some(10.0 * f64::from(surface))]).collect();
//! let readings = Readings::new(vec!["friction".into()], &rows)?;
//! let data = TrainingData::new(&embeddings, &readings);
//! let rerun = Rerun { number: 0, training: vec![0, 1, 3, 4], validation: vec![] };
//! let plan = Plan::each(7, readings.properties(), vec![rerun]);
//!
//! let trained = Ridge::new(RidgeConfig::default())?.train(&data, &plan)?;
//! assert_eq!(trained.ridges()[0].penalty(), 0.01); // the least of those tried
//! let estimates = trained.predict(&embeddings.select(&[2], &[0])?)?;
//! assert!((estimates[0].values[0] - 30.0).abs() < 1e-3);
//! # Ok::<(), sps_regress::Error>(())
//! ```

mod fit;
mod store;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::data::Embeddings;
use crate::error::{Error, Result};
use crate::groups::fit_groups;
use crate::plan::{Plan, TrainingData, Trial};
use crate::regressor::Estimates;
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
/// training surface is left out in turn, as scikit-learn's `RidgeCV`, or each unit of them
/// ([`TrainingData::units`]).
///
/// Several views of a surface enter side by side, and so do the blocks of embeddings, each scaled to a mean
/// variance of 1. The features are turned to their principal axes,
/// where every penalty's fit and errors have a closed form.
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
        let ridges = fit_groups(data, plan, |group| {
            let axes = Axes::new(&group.embeddings, &self.0.penalties, &group.left_out)?;
            let fits = group.jobs.par_iter().map(|job| TrainedRidge {
                trial: job.trial.clone(),
                fit: axes.fit(&job.values),
            });
            Ok(fits.collect())
        })?;
        Ok(TrainedRidges { ridges })
    }
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
