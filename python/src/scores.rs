//! Scores of one property.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use sps_metrics::{Metric, Samples, TrainingMean};

use crate::arrays::Numbers;
use crate::errors::{undefined, value_error};

/// A finite score and what it rests on; `float(score)` is its value, and numpy takes it for that number.
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
    fn __float__(&self) -> f64 {
        self.value
    }

    /// Its value, (), float64 unless `dtype` says otherwise: numpy makes an array of scores by it.
    #[pyo3(signature = (dtype = None, copy = None))]
    fn __array__<'py>(
        &self,
        py: Python<'py>,
        dtype: Option<&Bound<'py, PyAny>>,
        copy: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let settings = PyDict::new(py);
        settings.set_item("dtype", dtype)?;
        settings.set_item("copy", copy)?;
        py.import("numpy")?
            .call_method("array", (self.value,), Some(&settings))
    }

    fn __repr__(&self) -> String {
        let Self {
            value,
            samples,
            zero_truths,
        } = self;
        format!("Score(value={value:?}, samples={samples}, zero_truths={zero_truths})")
    }
}

/// R² as the paper writes it, about the mean of the training split: 1 - sum (t - e)² / sum (t - m)².
///
/// Raises UndefinedScore where there is none: no samples, unequal lengths, NaN or infinity, or every
/// truth equal to the mean.
#[pyfunction]
#[pyo3(signature = (*, truth, estimate, training_mean))]
pub(crate) fn r2(truth: Numbers, estimate: Numbers, training_mean: f64) -> PyResult<Score> {
    let mean = TrainingMean::new(training_mean).map_err(|error| undefined(&error))?;
    score(Metric::R2(mean), &truth, &estimate)
}

/// R² about the samples' own mean, as scikit-learn's `r2_score`.
///
/// Raises UndefinedScore as `r2` does, for a constant truth and for one sample.
#[pyfunction]
#[pyo3(signature = (*, truth, estimate))]
pub(crate) fn r2_own_mean(truth: Numbers, estimate: Numbers) -> PyResult<Score> {
    score(Metric::R2OwnMean, &truth, &estimate)
}

/// Mean absolute error, in the unit of the truth.
///
/// Raises UndefinedScore where there are no samples, unequal lengths, NaN or infinity.
#[pyfunction]
#[pyo3(signature = (*, truth, estimate))]
pub(crate) fn mae(truth: Numbers, estimate: Numbers) -> PyResult<Score> {
    score(Metric::Mae, &truth, &estimate)
}

/// Root of the mean squared error, in the unit of the truth.
///
/// Raises UndefinedScore as `mae` does.
#[pyfunction]
#[pyo3(signature = (*, truth, estimate))]
pub(crate) fn rmse(truth: Numbers, estimate: Numbers) -> PyResult<Score> {
    score(Metric::Rmse, &truth, &estimate)
}

/// Median of 100 |t - e| / |t|, in percent; truths of zero are left out and counted.
///
/// Raises UndefinedScore as `mae` does, and where every truth is zero.
#[pyfunction]
#[pyo3(signature = (*, truth, estimate))]
pub(crate) fn median_percent_error(truth: Numbers, estimate: Numbers) -> PyResult<Score> {
    score(Metric::MedianPercentError, &truth, &estimate)
}

/// Spearman's rank correlation, -1 to 1; equal values share their average rank.
///
/// Raises UndefinedScore as `mae` does, for constant truths or estimates and for one sample.
#[pyfunction]
#[pyo3(signature = (*, truth, estimate))]
pub(crate) fn spearman(truth: Numbers, estimate: Numbers) -> PyResult<Score> {
    score(Metric::Spearman, &truth, &estimate)
}

fn score(metric: Metric, truth: &Numbers, estimate: &Numbers) -> PyResult<Score> {
    let samples = Samples {
        truth: &truth.0,
        estimate: &estimate.0,
    };
    let score = metric.score(samples).map_err(|error| undefined(&error))?;
    Ok(Score {
        value: score.value,
        samples: score.samples,
        zero_truths: score.zero_truths,
    })
}

/// The metric of this name; R² takes the mean of the training split, the others none.
pub(crate) fn named(name: &str, training_mean: Option<f64>) -> PyResult<Metric> {
    let metric = match (name, training_mean) {
        ("r2", Some(mean)) => {
            return TrainingMean::new(mean)
                .map(Metric::R2)
                .map_err(|error| undefined(&error));
        }
        ("r2", None) => return Err(value_error("no training_mean, which r2 is about")),
        ("r2_own_mean", _) => Metric::R2OwnMean,
        ("mae", _) => Metric::Mae,
        ("rmse", _) => Metric::Rmse,
        ("median_percent_error", _) => Metric::MedianPercentError,
        ("spearman", _) => Metric::Spearman,
        _ => {
            return Err(value_error(format_args!(
                "unknown metric {name:?}, expected r2, r2_own_mean, mae, rmse, \
                 median_percent_error or spearman"
            )));
        }
    };
    match training_mean {
        None => Ok(metric),
        Some(_) => Err(value_error(format_args!(
            "a training_mean for {name}, expected none: only r2 is about it"
        ))),
    }
}
