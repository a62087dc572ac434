//! Estimates that another system made: from a file, beside those of the methods that are fitted here.

mod held_out;
mod lines;
mod problems;

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use sps_dataset::{Property, Source, Surface};
use sps_regress::Readings;

use super::fit::Judge;
use super::trials::TrialSpec;
use super::{Splits, tables};
use crate::cells;
use crate::config::{Estimator, Experiment, Given, Method};
use crate::data::About;
use crate::journal::{Outcome, Stop};
use problems::Problems;

#[derive(Debug)]
pub(crate) struct Estimates {
    /// A hash of the file's bytes.
    content: String,
    /// Whether each rerun has its own.
    by_rerun: bool,
    of: HashMap<Place, Estimate>,
}

/// What is estimated: a property, in a rerun, of a surface by its index. Where reruns have no estimates
/// of their own, all are of rerun 0.
type Place = (Property, usize, usize);

#[derive(Debug)]
struct Estimate {
    line: u64,
    value: f64,
    /// Its lower and upper end.
    interval: Option<[f64; 2]>,
}

impl Estimates {
    /// Tells files of other content apart.
    pub(crate) fn content(&self) -> &str {
        &self.content
    }

    fn get(&self, property: &Property, rerun: usize, surface: usize) -> Option<&Estimate> {
        let rerun = if self.by_rerun { rerun } else { 0 };
        self.of.get(&(property.clone(), rerun, surface))
    }
}

/// The experiment that estimates are for.
struct Asked<'a> {
    surfaces: &'a [Surface],
    /// All that the dataset measures.
    measured: &'a [Property],
    /// Those that the experiment estimates.
    properties: Vec<Property>,
    readings: Readings,
    splits: &'a Splits,
}

/// Reads the file of each of the methods that has one.
///
/// # Errors
///
/// Everything that is wrong with a file, by its lines.
pub(super) fn read(
    experiment: &Experiment,
    methods: &mut [Method],
    (source, about): (&dyn Source, &About),
    splits: &Splits,
) -> Result<()> {
    if methods
        .iter()
        .all(|method| method.estimator.file().is_none())
    {
        return Ok(());
    }
    let surfaces = source.surfaces();
    let asked = Asked {
        surfaces,
        measured: &source.tactile().properties,
        properties: tables::properties(source, &experiment.properties)?,
        readings: tables::readings(source, about, surfaces.len())?,
        splits,
    };
    for method in methods {
        let Some(file) = method.estimator.file().map(Path::to_owned) else {
            continue;
        };
        let estimates = asked.read(&file, method);
        let estimates = estimates.with_context(|| format!("method `{}`, `file`", method.id))?;
        method.estimator = Estimator::Given(Given {
            file,
            estimates: Some(Arc::new(estimates)),
        });
    }
    Ok(())
}

impl Asked<'_> {
    fn read(&self, file: &Path, method: &Method) -> Result<Estimates> {
        let text = cells::text(file);
        let text = text.with_context(|| format!("cannot read {}", file.display()))?;
        let mut problems = Problems::of(file);
        let estimates = lines::read(&text, self, &mut problems)?;
        if let Some(estimates) = &estimates {
            held_out::check(self, method, estimates, &mut problems);
        }
        problems.ensure_none()?;
        estimates.context("no estimates")
    }
}

pub(super) fn outcomes(
    judge: &Judge<'_>,
    trials: &[&TrialSpec],
    estimates: &Estimates,
) -> Result<Vec<Outcome>> {
    let outcomes = trials.iter().map(|trial| outcome(judge, trial, estimates));
    outcomes.collect()
}

fn outcome(judge: &Judge<'_>, trial: &TrialSpec, estimates: &Estimates) -> Result<Outcome> {
    let (tables, splits) = (judge.tables(), judge.splits);
    let rerun = trial.rerun / splits.of_rerun;
    let held_out = judge.held_out(trial)?;
    let given = held_out.surfaces.iter().map(|&surface| {
        let estimate = estimates.get(&trial.property, rerun, surface);
        estimate.context("a held-out surface without an estimate")
    });
    let given = given.collect::<Result<Vec<&Estimate>>>()?;
    let deviation = deviation(&tables.measured(&trial.property, &splits.all[trial.rerun].train));
    let stops = given.iter().filter_map(|estimate| {
        let [low, high] = estimate.interval?;
        Some(Stop {
            views: 0,
            low,
            high,
            width: (high - low) / deviation,
        })
    });
    let values = given.iter().map(|estimate| estimate.value);
    Ok(Outcome {
        stops: stops.collect(),
        ..judge.outcome(trial, held_out, values.collect())
    })
}

/// The standard deviation of readings; 1 where they do not differ.
fn deviation(readings: &[(usize, f64)]) -> f64 {
    let count = readings.len().max(1) as f64;
    let mean = readings.iter().map(|(_, value)| value).sum::<f64>() / count;
    let squares = readings.iter().map(|(_, value)| (value - mean).powi(2));
    let deviation = (squares.sum::<f64>() / count).sqrt();
    if deviation > 0.0 { deviation } else { 1.0 }
}
