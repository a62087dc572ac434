//! Intervals of predictions, and whether they cover.

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2};
use pyo3::prelude::*;
use sps_metrics::{Level, PredictionInterval};

use crate::arrays::{Labels, Numbers};
use crate::errors::{Raises, UndefinedScore};
use crate::scores::Scored;

/// Intervals around estimates that cover the truth at a promised rate, by split conformal prediction.
///
/// `residuals`, of shape (samples,), are truth less estimate (the sign does not matter) of samples
/// that the model was not fitted to and that are exchangeable with those to come.
///
/// Raises ValueError where the level needs more samples, UndefinedScore for NaN and infinity.
#[pyclass(module = "sps", frozen)]
pub(crate) struct SplitConformal(sps_metrics::SplitConformal);

/// Intervals that cover a sample of a new group at a promised rate, by hierarchical conformal
/// prediction: for samples that come in groups whose members are alike.
///
/// `residuals` are as in SplitConformal, of groups that the model was not fitted to; `groups` says
/// which group each is of, by numbers or strings.
///
/// Raises ValueError where the level needs more groups, UndefinedScore for NaN and infinity.
#[pyclass(module = "sps", frozen)]
pub(crate) struct GroupConformal(sps_metrics::GroupConformal);

/// How intervals fared on truths.
#[pyclass(module = "sps", frozen, get_all)]
pub(crate) struct Coverage {
    /// Truths that lie in their interval, its ends included.
    covered: usize,
    /// Truths that there are.
    samples: usize,
    /// The share of truths that lie in their interval.
    fraction: f64,
    /// Mean width of the intervals, in the unit of the truth.
    mean_width: f64,
}

#[pymethods]
impl SplitConformal {
    #[new]
    #[pyo3(signature = (residuals, *, level = 0.9))]
    fn new(residuals: Numbers, level: f64) -> Raises<Self> {
        let of = sps_metrics::SplitConformal::from_residuals;
        Ok(Self(of(&residuals.0, Level::new(level)?)?))
    }

    /// Half the width of every interval, in the unit of the truth.
    #[getter]
    fn radius(&self) -> f64 {
        self.0.radius
    }

    /// The coverage to expect: at least the level, and above it by less than 1 / (samples + 1).
    #[getter]
    fn expected_coverage(&self) -> f64 {
        self.0.expected_coverage()
    }

    /// The intervals around estimates of shape (n,): (n, 2), low and high.
    fn intervals<'py>(&self, py: Python<'py>, estimates: Numbers) -> Bound<'py, PyArray2<f64>> {
        intervals(py, &estimates, self.0.radius)
    }

    fn __repr__(&self) -> String {
        let (radius, level) = (self.0.radius, self.0.level.get());
        let samples = self.0.samples;
        format!("SplitConformal(radius={radius:?}, level={level:?}, samples={samples})")
    }
}

#[pymethods]
impl GroupConformal {
    #[new]
    #[pyo3(signature = (residuals, groups, *, level = 0.9))]
    fn new(residuals: Numbers, groups: Labels, level: f64) -> Raises<Self> {
        let of = sps_metrics::GroupConformal::from_residuals;
        Ok(Self(of(&residuals.0, &groups.0, Level::new(level)?)?))
    }

    /// Half the width of every interval, in the unit of the truth.
    #[getter]
    fn radius(&self) -> f64 {
        self.0.radius
    }

    /// Groups that it was calibrated on.
    #[getter]
    fn groups(&self) -> usize {
        self.0.groups
    }

    /// The intervals around estimates of shape (n,): (n, 2), low and high.
    fn intervals<'py>(&self, py: Python<'py>, estimates: Numbers) -> Bound<'py, PyArray2<f64>> {
        intervals(py, &estimates, self.0.radius)
    }

    fn __repr__(&self) -> String {
        let (radius, level) = (self.0.radius, self.0.level.get());
        let groups = self.0.groups;
        format!("GroupConformal(radius={radius:?}, level={level:?}, groups={groups})")
    }
}

#[pymethods]
impl Coverage {
    fn __repr__(&self) -> String {
        shown!(Coverage, self, covered samples fraction mean_width)
    }
}

/// The share of `y_true` that lies in its interval, from `low` to `high`, all (n,): a float; with `details` a
/// Coverage.
///
/// Raises UndefinedScore where there are none, lengths differ, an end is NaN or infinite, or an
/// interval ends below its start.
#[pyfunction]
#[pyo3(signature = (y_true, low, high, *, details = false))]
pub(crate) fn coverage(
    y_true: Numbers,
    low: Numbers,
    high: Numbers,
    details: bool,
) -> Raises<Scored> {
    let lengths = (low.0.len(), high.0.len());
    if lengths.0 != lengths.1 {
        let problem = format!("{} lower ends and {} upper ends", lengths.0, lengths.1);
        return Err(UndefinedScore::new_err(problem).into());
    }
    let ends = low.0.into_iter().zip(high.0);
    let intervals = ends.map(|(low, high)| PredictionInterval { low, high });
    let intervals: Vec<PredictionInterval> = intervals.collect();
    let coverage = sps_metrics::coverage(&intervals, &y_true.0)?;
    let fraction = coverage.fraction();
    if !details {
        return Ok(Scored::Number(fraction));
    }
    Ok(Scored::Coverage(Coverage {
        covered: coverage.covered,
        samples: coverage.samples,
        fraction,
        mean_width: coverage.mean_width,
    }))
}

fn intervals<'py>(py: Python<'py>, estimates: &Numbers, radius: f64) -> Bound<'py, PyArray2<f64>> {
    let of = |&estimate: &f64| {
        let PredictionInterval { low, high } = PredictionInterval::around(estimate, radius);
        [low, high]
    };
    let ends: Vec<[f64; 2]> = estimates.0.iter().map(of).collect();
    Array2::from(ends).into_pyarray(py)
}
