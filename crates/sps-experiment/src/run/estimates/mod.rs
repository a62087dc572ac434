//! Estimates that another system made: from a file, beside those of the methods that are fitted here.

mod lines;
mod problems;

use std::collections::{BTreeSet, HashMap};
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

/// So many surfaces without an estimate are named.
const NAMED: usize = 5;

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

/// Reads the file of each of the methods that has one. An error is everything that is wrong with it, by its
/// lines.
pub(super) fn read(
    experiment: &Experiment,
    methods: &mut [Method],
    (source, about): (&dyn Source, &About),
    splits: &Splits,
) -> Result<()> {
    let mut files = methods.iter().filter_map(|method| method.estimator.file());
    if files.next().is_none() {
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
            self.check(method, estimates, &mut problems);
        }
        problems.ensure_none()?;
        estimates.context("no estimates")
    }

    /// Names what a method is scored on without an estimate of it. A surface that was not measured is not
    /// scored on, and needs none.
    fn check(&self, method: &Method, estimates: &Estimates, problems: &mut Problems<'_>) {
        let by_rerun = estimates.by_rerun;
        let (of_rerun, all) = (self.splits.of_rerun, self.splits.all.len());
        let together = if by_rerun { of_rerun } else { all };
        for property in &self.properties {
            if !estimates.of.keys().any(|(of, ..)| of == property) {
                let problem = || format!("no row of `{property}`, which the experiment estimates");
                problems.of_all(problem);
                continue;
            }
            let column = self.readings.column(property.code());
            let reading = |surface: usize| self.readings.get(surface, column?);
            for (rerun, splits) in self.splits.all.chunks(together).enumerate() {
                let held_out = splits.iter();
                let held_out = held_out.flat_map(|split| method.scored_on(&split.validation));
                let held_out = held_out.filter(|&&surface| reading(surface).is_some());
                let held_out: BTreeSet<usize> = held_out.copied().collect();
                let lacks = |&&at: &&usize| estimates.get(property, rerun, at).is_none();
                let missing = held_out.iter().filter(lacks);
                let missing: Vec<&str> = missing.map(|&at| &self.surfaces[at].id[..]).collect();
                if missing.is_empty() {
                    continue;
                }
                let (count, all) = (missing.len(), held_out.len());
                let (named, others) = missing.split_at(count.min(NAMED));
                let in_rerun = by_rerun.then(|| format!(" in rerun {rerun}"));
                let more = (!others.is_empty()).then(|| format!(" and {} more", others.len()));
                let [in_rerun, more] = [in_rerun, more].map(Option::unwrap_or_default);
                let named = named.join(", ");
                problems.of_all(|| {
                    format!(
                        "no estimate of `{property}` for {count} of the {all} surfaces held \
                         out{in_rerun}: {named}{more}"
                    )
                });
            }
        }
    }
}

pub(super) fn outcome(
    judge: &Judge<'_>,
    trial: &TrialSpec,
    estimates: &Estimates,
) -> Result<Outcome> {
    let rerun = trial.rerun / judge.splits.of_rerun;
    let (surfaces, outcome) = judge.held_out(trial)?;
    let given = surfaces.iter().map(|&surface| {
        let estimate = estimates.get(&trial.property, rerun, surface);
        estimate.context("a held-out surface without an estimate")
    });
    let given = given.collect::<Result<Vec<&Estimate>>>()?;
    let stops = given.iter().filter_map(|estimate| {
        let [low, high] = estimate.interval?;
        Some(Stop {
            views: 0,
            low,
            high,
            width: None,
        })
    });
    Ok(Outcome {
        stops: stops.collect(),
        estimate: given.iter().map(|estimate| estimate.value).collect(),
        ..outcome
    })
}
