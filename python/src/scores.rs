//! Scores of one property.

use anyhow::{Result, bail, ensure};
use pyo3::prelude::*;
use sps_metrics::{Metric, Samples, TrainingMean};

use crate::arrays::Numbers;
use crate::conformal::Coverage;
use crate::errors::Raises;

/// A finite score and what it rests on.
#[pyclass(module = "sps", frozen, get_all)]
pub(crate) struct Score {
    /// In the unit of its metric: none for R² and Spearman, the truth's for MAE and RMSE, percent for
    /// the median percentage error.
    value: f64,
    /// Samples that the value rests on.
    samples: usize,
    /// Samples left out because their truth is zero, which has no percentage; 0 for other metrics.
    zero_truths: usize,
}

#[pymethods]
impl Score {
    fn __repr__(&self) -> String {
        shown!(Score, self, value samples zero_truths)
    }
}

/// A number, or all that is known of it.
#[derive(IntoPyObject)]
pub(crate) enum Scored {
    Number(f64),
    Score(Score),
    Coverage(Coverage),
}

/// R², 1 - sum (t - e)² / sum (t - m)², where m is `training_mean`, as the paper has it, or else the mean
/// of y_true, as scikit-learn's `r2_score` has it. A float; with `details`, as of every metric here, a Score.
///
/// Raises UndefinedScore where there is none: no samples, unequal lengths, NaN or infinity, every truth
/// equal to the mean, and one sample about its own mean.
#[pyfunction]
#[pyo3(signature = (y_true, y_pred, *, training_mean = None, details = false))]
pub(crate) fn r2(
    y_true: Numbers,
    y_pred: Numbers,
    training_mean: Option<f64>,
    details: bool,
) -> Raises<Scored> {
    score(named("r2", training_mean)?, &y_true, &y_pred, details)
}

/// Mean absolute error, in the unit of the truth.
///
/// Raises UndefinedScore where there are no samples, unequal lengths, NaN or infinity.
#[pyfunction]
#[pyo3(signature = (y_true, y_pred, *, details = false))]
pub(crate) fn mae(y_true: Numbers, y_pred: Numbers, details: bool) -> Raises<Scored> {
    score(Metric::Mae, &y_true, &y_pred, details)
}

/// Root of the mean squared error, in the unit of the truth.
///
/// Raises UndefinedScore as `mae` does.
#[pyfunction]
#[pyo3(signature = (y_true, y_pred, *, details = false))]
pub(crate) fn rmse(y_true: Numbers, y_pred: Numbers, details: bool) -> Raises<Scored> {
    score(Metric::Rmse, &y_true, &y_pred, details)
}

/// Median of 100 |t - e| / |t|, in percent; truths of zero are left out and counted.
///
/// Raises UndefinedScore as `mae` does, and where every truth is zero.
#[pyfunction]
#[pyo3(signature = (y_true, y_pred, *, details = false))]
pub(crate) fn median_percent_error(
    y_true: Numbers,
    y_pred: Numbers,
    details: bool,
) -> Raises<Scored> {
    score(Metric::MedianPercentError, &y_true, &y_pred, details)
}

/// Spearman's rank correlation, -1 to 1; equal values share their average rank.
///
/// Raises UndefinedScore as `mae` does, for constant truths or estimates and for one sample.
#[pyfunction]
#[pyo3(signature = (y_true, y_pred, *, details = false))]
pub(crate) fn spearman(y_true: Numbers, y_pred: Numbers, details: bool) -> Raises<Scored> {
    score(Metric::Spearman, &y_true, &y_pred, details)
}

fn score(metric: Metric, truth: &Numbers, estimate: &Numbers, details: bool) -> Raises<Scored> {
    let samples = Samples {
        truth: &truth.0,
        estimate: &estimate.0,
    };
    let score = metric.score(samples)?;
    if !details {
        return Ok(Scored::Number(score.value));
    }
    Ok(Scored::Score(Score {
        value: score.value,
        samples: score.samples,
        zero_truths: score.zero_truths,
    }))
}

/// The metric of this name; R² may be about the mean of the training split, the others not.
pub(crate) fn named(name: &str, training_mean: Option<f64>) -> Result<Metric> {
    if name == "r2" {
        let mean = training_mean.map(TrainingMean::new).transpose()?;
        return Ok(mean.map_or(Metric::R2OwnMean, Metric::R2));
    }
    let others = Metric::ABOUT_NO_MEAN;
    let Some(metric) = others.into_iter().find(|metric| metric.id() == name) else {
        let others = others.map(Metric::id).join(", ");
        bail!("unknown metric {name:?}, expected r2, {others}");
    };
    ensure!(
        training_mean.is_none(),
        "a training_mean for {name}, expected none: only r2 is about it"
    );
    Ok(metric)
}
