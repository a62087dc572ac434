//! Intervals of scores over units.

use pyo3::prelude::*;
use sps_metrics::{BootstrapError, Compared, Level, Samples, Scored};

use crate::arrays::{Labels, Numbers};
use crate::errors::{bootstrap_error, value_error};
use crate::scores::named;

/// Percentile bootstrap over units: how far a score would move if other units of the same kind had
/// been tested.
///
/// A unit is what was drawn independently: a surface, or a group of surfaces that are alike. The
/// same seed draws the same units for every score and method, on every machine.
///
/// Raises ValueError unless 0 < level < 1.
#[pyclass(module = "sps", frozen)]
pub(crate) struct Bootstrap(sps_metrics::Bootstrap);

/// A score, or the difference of two, with its interval.
#[pyclass(module = "sps", frozen, get_all)]
pub(crate) struct BootstrapInterval {
    /// The score of the samples as they are, or the first method's less the second's.
    estimate: f64,
    /// The lower end.
    low: f64,
    /// The upper end.
    high: f64,
    /// The share of resamples between the ends.
    level: f64,
    /// Units that were drawn from.
    units: usize,
    /// Resamples that were drawn.
    resamples: usize,
    /// Resamples without a score; each counts as lying beyond both ends.
    undefined_resamples: usize,
}

#[pymethods]
impl Bootstrap {
    #[new]
    #[pyo3(signature = (seed = 0, *, resamples = 2000, level = 0.95))]
    fn new(seed: u64, resamples: usize, level: f64) -> PyResult<Self> {
        let level = Level::new(level).map_err(value_error)?;
        let bootstrap = sps_metrics::Bootstrap::new(seed);
        Ok(Self(bootstrap.with_resamples(resamples).with_level(level)))
    }

    /// The interval of a score.
    ///
    /// `metric` is r2 (with `training_mean`), r2_own_mean, mae, rmse, median_percent_error or
    /// spearman; `truth` and `estimate` are of shape (samples,), and `units` says which unit each
    /// sample is of, by numbers or strings (None: each is a unit of its own).
    ///
    /// Raises UndefinedScore where the score has no value, ValueError where there are too few units
    /// or resamples.
    #[pyo3(signature = (metric, *, truth, estimate, units = None, training_mean = None))]
    fn interval(
        &self,
        py: Python<'_>,
        metric: &str,
        truth: Numbers,
        estimate: Numbers,
        units: Option<Labels>,
        training_mean: Option<f64>,
    ) -> PyResult<BootstrapInterval> {
        let scored = Scored {
            metric: named(metric, training_mean)?,
            samples: Samples {
                truth: &truth.0,
                estimate: &estimate.0,
            },
            units: units.as_ref().map(|units| &units.0[..]),
        };
        found(py.detach(|| self.0.interval(&scored)))
    }

    /// The interval of the difference between two methods' scores, first less second, both scored
    /// on the same drawn units.
    ///
    /// Arguments and errors are those of `interval`; `first` and `second` are the methods' estimates.
    #[pyo3(signature = (metric, *, truth, first, second, units = None, training_mean = None))]
    #[expect(clippy::too_many_arguments, reason = "each is a keyword")]
    fn difference(
        &self,
        py: Python<'_>,
        metric: &str,
        truth: Numbers,
        first: Numbers,
        second: Numbers,
        units: Option<Labels>,
        training_mean: Option<f64>,
    ) -> PyResult<BootstrapInterval> {
        let compared = Compared {
            metric: named(metric, training_mean)?,
            truth: &truth.0,
            first: &first.0,
            second: &second.0,
            units: units.as_ref().map(|units| &units.0[..]),
        };
        found(py.detach(|| self.0.difference(&compared)))
    }
}

#[pymethods]
impl BootstrapInterval {
    /// Whether zero lies outside of the interval: for a difference, whether the methods differ.
    fn excludes_zero(&self) -> bool {
        self.low > 0.0 || self.high < 0.0
    }

    fn __repr__(&self) -> String {
        let Self {
            estimate,
            low,
            high,
            level,
            units,
            ..
        } = self;
        format!(
            "BootstrapInterval(estimate={estimate:?}, low={low:?}, high={high:?}, \
             level={level:?}, units={units})"
        )
    }
}

fn found(
    interval: Result<sps_metrics::BootstrapInterval, BootstrapError>,
) -> PyResult<BootstrapInterval> {
    let interval = interval.map_err(|error| bootstrap_error(&error))?;
    Ok(BootstrapInterval {
        estimate: interval.estimate,
        low: interval.low,
        high: interval.high,
        level: interval.level.get(),
        units: interval.units,
        resamples: interval.resamples,
        undefined_resamples: interval.undefined_resamples,
    })
}
