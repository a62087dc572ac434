//! Intervals of scores over units and reruns.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use pyo3::prelude::*;
use sps_metrics::{Intervals, Level, Metric, Samples, Scored};

use crate::arrays::{Labels, Numbers};
use crate::errors::Raises;
use crate::scores::named;

/// A score, or the difference of two, with its interval.
#[pyclass(module = "sps", frozen, get_all)]
pub(crate) struct ScoreInterval {
    /// The score of the samples as they are, or the first method's less the second's.
    estimate: f64,
    /// The lower end.
    low: f64,
    /// The upper end.
    high: f64,
    /// The share of such intervals that hold the true value.
    level: f64,
    /// Units that it is over.
    units: usize,
    /// Reruns that it is over.
    reruns: usize,
    /// The standard error that units and reruns make together.
    standard_error: f64,
    /// The two-sided p-value of a true value of 0.
    p: f64,
}

/// The interval of a score: how far it would move if other units had been tested, and where `reruns`
/// are given if other models had been trained.
///
/// `metric` is the name of a score, as r2 or mae; `y_true` and `y_pred` are of shape (samples,). `units`
/// says which unit each sample is of, by numbers or strings: a surface, or a group of surfaces that are
/// alike (None: each is a unit of its own, in a rerun the first of one that of another). `reruns` says
/// likewise which training each estimate is of (None: all are of one model, and the interval is for that
/// model). Where the reruns part one set of surfaces anew, `test_per_training` is how many are tested for
/// each that is trained on, 1/9 in ten folds.
///
/// Raises UndefinedScore where the score has no value, ValueError where there are fewer than two
/// units or reruns.
#[pyfunction]
#[pyo3(signature = (metric, y_true, y_pred, *, units = None, reruns = None, training_mean = None,
                    level = 0.95, test_per_training = 0.0))]
#[expect(clippy::too_many_arguments, reason = "each is a keyword")]
pub(crate) fn interval(
    py: Python<'_>,
    metric: &str,
    y_true: Numbers,
    y_pred: Numbers,
    units: Option<Labels>,
    reruns: Option<Labels>,
    training_mean: Option<f64>,
    level: f64,
    test_per_training: f64,
) -> Raises<ScoreInterval> {
    let metric = named(metric, training_mean)?;
    let intervals = intervals(level, reruns.is_some(), test_per_training)?;
    let groups = Group::all(&y_true.0, &[&y_pred.0], units.as_ref(), reruns.as_ref())?;
    let found = py.detach(|| intervals.interval(&scored(metric, &groups, 0)))?;
    Ok(found.into())
}

/// The interval of the difference between two methods' scores, first less second, on the same units
/// and reruns.
///
/// Arguments and errors are those of `interval`; `first` and `second` are the methods' estimates.
#[pyfunction]
#[pyo3(signature = (metric, y_true, first, second, *, units = None, reruns = None,
                    training_mean = None, level = 0.95, test_per_training = 0.0))]
#[expect(clippy::too_many_arguments, reason = "each is a keyword")]
pub(crate) fn difference(
    py: Python<'_>,
    metric: &str,
    y_true: Numbers,
    first: Numbers,
    second: Numbers,
    units: Option<Labels>,
    reruns: Option<Labels>,
    training_mean: Option<f64>,
    level: f64,
    test_per_training: f64,
) -> Raises<ScoreInterval> {
    let metric = named(metric, training_mean)?;
    let intervals = intervals(level, reruns.is_some(), test_per_training)?;
    let both = [&first.0[..], &second.0];
    let groups = Group::all(&y_true.0, &both, units.as_ref(), reruns.as_ref())?;
    let found = py.detach(|| {
        let [first, second] = [0, 1].map(|method| scored(metric, &groups, method));
        intervals.difference(&first, &second)
    })?;
    Ok(found.into())
}

/// P-values corrected for how many were looked at (Holm 1979), in the same order: calling those
/// real that are at most q, chance alone makes any call with a probability of at most q.
#[pyfunction]
pub(crate) fn holm(p_values: Numbers) -> Vec<f64> {
    sps_metrics::holm(&p_values.0)
}

fn intervals(level: f64, reruns: bool, test_per_training: f64) -> Result<Intervals> {
    let level = Level::new(level)?;
    ensure!(
        test_per_training.is_finite() && test_per_training >= 0.0,
        "test_per_training is {test_per_training}, expected a number from 0 on"
    );
    let intervals = if reruns {
        Intervals::of_training(level)
    } else {
        Intervals::of_models(level)
    };
    Ok(intervals.sharing(test_per_training))
}

/// The samples of a rerun.
#[derive(Default)]
struct Group {
    rerun: usize,
    truth: Vec<f64>,
    /// Of each method.
    estimates: Vec<Vec<f64>>,
    units: Vec<usize>,
}

impl Group {
    fn all(
        truth: &[f64],
        estimates: &[&[f64]],
        units: Option<&Labels>,
        reruns: Option<&Labels>,
    ) -> Result<Vec<Self>> {
        let samples = truth.len();
        let lengths = estimates.iter().map(|all| ("estimates", all.len()));
        let labels = [("units", units), ("reruns", reruns)].into_iter();
        let labels = labels.filter_map(|(name, labels)| Some((name, labels?.0.len())));
        for (name, found) in lengths.chain(labels) {
            ensure!(found == samples, "{found} {name} for {samples} samples");
        }
        let mut groups: BTreeMap<usize, Self> = BTreeMap::new();
        for at in 0..samples {
            let rerun = reruns.map_or(0, |reruns| reruns.0[at]);
            let group = groups.entry(rerun).or_insert_with(|| Self {
                rerun,
                estimates: vec![Vec::new(); estimates.len()],
                ..Self::default()
            });
            let unit = units.map_or(group.truth.len(), |units| units.0[at]);
            group.units.push(unit);
            group.truth.push(truth[at]);
            for (kept, all) in group.estimates.iter_mut().zip(estimates) {
                kept.push(all[at]);
            }
        }
        Ok(groups.into_values().collect())
    }
}

/// The groups as a method is scored on them.
fn scored(metric: Metric, groups: &[Group], method: usize) -> Vec<Scored<'_>> {
    let scored = groups.iter().map(|group| Scored {
        metric,
        samples: Samples {
            truth: &group.truth,
            estimate: &group.estimates[method],
        },
        units: Some(&group.units),
        rerun: group.rerun,
    });
    scored.collect()
}

#[pymethods]
impl ScoreInterval {
    /// Whether zero lies outside of the interval: for a single difference that was asked for
    /// beforehand, whether the methods differ.
    fn excludes_zero(&self) -> bool {
        self.low > 0.0 || self.high < 0.0
    }

    fn __repr__(&self) -> String {
        shown!(ScoreInterval, self, estimate low high level units reruns)
    }
}

impl From<sps_metrics::ScoreInterval> for ScoreInterval {
    fn from(found: sps_metrics::ScoreInterval) -> Self {
        Self {
            estimate: found.estimate,
            low: found.low,
            high: found.high,
            level: found.level.get(),
            units: found.units,
            reruns: found.reruns,
            standard_error: found.standard_error,
            p: found.p,
        }
    }
}
