//! Ridge regression from embeddings to tactile values: the honest floor under every network.
//!
//! ```
//! use sps_regress::ridge::Ridge;
//! use sps_regress::{Embeddings, FittedRegressor, Plan, Readings, Rerun, TrainingData};
//!
//! // One feature, and a reading that is a line in it.
//! let embeddings = Embeddings::new(vec![1.0, 2.0, 3.0, 4.0, 5.0], [5, 1, 1])?;
//! let rows: Vec<_> = (1..6).map(|surface| vec![Some(10.0 * f64::from(surface))]).collect();
//! let readings = Readings::new(vec!["friction".into()], &rows)?;
//! let data = TrainingData::new(&embeddings, &readings);
//! let rerun = Rerun::new(0, vec![0, 1, 3, 4]);
//! let plan = Plan::each(7, readings.properties(), vec![rerun]);
//!
//! let trained = Ridge::default().train(&data, &plan)?;
//! assert_eq!(trained.models()[0].penalty(), 0.01); // the least of those tried
//! let estimates = trained.predict(&embeddings.select(&[2], &[0])?)?;
//! assert!((estimates[0].values[0] - 30.0).abs() < 1e-3);
//! # Ok::<(), sps_regress::Error>(())
//! ```

mod fit;

use ndarray::ArrayView1;
use serde::{Deserialize, Serialize};
use sps_base::parallel;

use crate::data::Embeddings;
use crate::error::{Error, Result};
use crate::fitted::{Fitted, FittedModel};
use crate::groups::{Job, fit_groups};
use crate::plan::{Plan, TrainingData, Trial};
use crate::regressor::{check_finite, check_positive};
use fit::Axes;

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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ridge(RidgeConfig);

impl Ridge {
    /// Checks a configuration.
    ///
    /// # Errors
    /// No penalty, or one that is not above zero.
    pub fn new(config: RidgeConfig) -> Result<Self> {
        check_positive("ridge penalties", &config.penalties)?;
        Ok(Self(config))
    }

    /// The configuration.
    pub fn config(&self) -> &RidgeConfig {
        &self.0
    }

    /// Fits every trial of the plan, on the threads of the current rayon pool. A trial's fit
    /// depends on its own data alone.
    ///
    /// # Errors
    /// A plan that does not fit the data, a trial without fixed views, a property without a
    /// training reading.
    pub fn train(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<TrainedRidges> {
        let ridges = fit_groups(data, plan, |group| {
            let axes = Axes::new(&group.embeddings, &self.0.penalties, &group.left_out)?;
            let fit = |job: &Job<'_>| axes.fit(job.trial, &job.values);
            Ok(parallel::map(&group.jobs, fit))
        })?;
        Ok(Fitted(ridges))
    }
}

/// One fitted ridge regression: a plane over the features of all views side by side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct TrainedRidge {
    trial: Trial,
    penalty: f64,
    intercept: f64,
    /// `(views x width)`.
    weights: Vec<f64>,
}

/// Fitted ridge regressions.
pub type TrainedRidges = Fitted<TrainedRidge>;

impl TrainedRidge {
    /// The penalty that was chosen, in the units of [`RidgeConfig::penalties`].
    pub fn penalty(&self) -> f64 {
        self.penalty
    }

    /// One estimate per surface.
    fn predict(&self, embeddings: &Embeddings) -> Result<Vec<f64>> {
        if embeddings.views() * embeddings.width() != self.weights.len() {
            let (views, width) = (embeddings.views(), embeddings.width());
            return Err(Error::input(
                "embeddings for ridge regression",
                format_args!("{views} views of width {width}"),
                format_args!("{} features in all", self.weights.len()),
            ));
        }
        let weights = ArrayView1::from(&self.weights);
        Ok((embeddings.table().dot(&weights) + self.intercept).to_vec())
    }
}

/// Kept as JSON: small enough, and every digit is kept.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct File {
    format: u32,
    ridges: Vec<TrainedRidge>,
}

const FORMAT: u32 = 1;

impl FittedModel for TrainedRidge {
    const KIND: &'static str = "ridges";

    fn trial(&self) -> &Trial {
        &self.trial
    }

    fn estimate(models: &[Self], embeddings: &Embeddings) -> Result<Vec<Vec<f64>>> {
        let estimates = parallel::map(models, |model| model.predict(embeddings));
        estimates.into_iter().collect()
    }

    fn multiply_adds(models: &[Self]) -> u64 {
        models.iter().map(|model| model.weights.len() as u64).sum()
    }

    fn to_bytes(models: &[Self]) -> Result<Vec<u8>> {
        for model in models {
            let others = [&model.penalty, &model.intercept];
            let numbers = model.weights.iter().chain(others).copied();
            check_finite("ridge regressions", numbers)?;
        }
        let file = File {
            format: FORMAT,
            ridges: models.to_vec(),
        };
        serde_json::to_vec(&file)
            .map_err(|error| Error::input("ridge regressions", error, "finite weights"))
    }

    fn from_bytes(bytes: &[u8]) -> Result<Vec<Self>> {
        let file: File = serde_json::from_slice(bytes)
            .map_err(|error| Error::input("ridge regressions", error, "a file of them"))?;
        if file.format != FORMAT {
            let what = "format of ridge regressions";
            return Err(Error::input(what, file.format, FORMAT));
        }
        Ok(file.ridges)
    }
}
