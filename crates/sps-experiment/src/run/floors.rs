//! Estimates that look at no image: those that any method has to be better than, and those of others.

use std::collections::HashMap;

use anyhow::Result;

use super::estimates;
use super::fit::Judge;
use super::trials::TrialSpec;
use crate::config::Estimator;
use crate::journal::Outcome;

/// The outcomes of a method that looks at nothing; `None` for one that does.
pub(super) fn outcomes(judge: &Judge<'_>, trials: &[&TrialSpec]) -> Result<Option<Vec<Outcome>>> {
    let by_label = match &judge.method.estimator {
        Estimator::Mean => false,
        Estimator::LabelMean => true,
        Estimator::Given(given) => {
            return estimates::outcomes(judge, trials, given.estimates()?).map(Some);
        }
        Estimator::Fitted(_) => return Ok(None),
    };
    let outcome = |trial: &&TrialSpec| {
        let held_out = judge.held_out(trial)?;
        let means = Means::of(judge, trial, by_label);
        let surfaces = held_out.surfaces.iter();
        let estimate = surfaces
            .map(|&surface| means.of_surface(judge, surface))
            .collect();
        Ok(judge.outcome(trial, held_out, estimate))
    };
    trials.iter().map(outcome).collect::<Result<_>>().map(Some)
}

struct Means<'a> {
    all: f64,
    /// By material; empty where labels are not read.
    of_material: HashMap<&'a str, f64>,
}

impl<'a> Means<'a> {
    fn of(judge: &Judge<'a>, trial: &TrialSpec, by_label: bool) -> Self {
        let split = &judge.splits.all[trial.rerun];
        let mut all = Vec::new();
        let mut of_material: HashMap<&str, Vec<f64>> = HashMap::new();
        for (surface, value) in judge.tables().measured(&trial.property, &split.train) {
            all.push(value);
            if by_label {
                let material = &judge.tables().surfaces[surface].material;
                of_material.entry(material).or_default().push(value);
            }
        }
        let of_material = of_material.into_iter();
        Self {
            all: mean(&all),
            of_material: of_material
                .map(|(name, values)| (name, mean(&values)))
                .collect(),
        }
    }

    /// That of all where no training surface is of the material.
    fn of_surface(&self, judge: &Judge<'_>, surface: usize) -> f64 {
        let material = judge.tables().surfaces[surface].material.as_str();
        self.of_material.get(material).copied().unwrap_or(self.all)
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
