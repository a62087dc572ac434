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
            let given = given.estimates()?;
            let outcome = |trial: &&TrialSpec| estimates::outcome(judge, trial, given);
            return trials.iter().map(outcome).collect::<Result<_>>().map(Some);
        }
        Estimator::Fitted(_) => return Ok(None),
    };
    let outcome = |trial: &&TrialSpec| {
        let (surfaces, outcome) = judge.held_out(trial)?;
        let tables = judge.tables();
        let material = |surface: usize| tables.surfaces[surface].material.as_str();
        let training = &judge.splits.all[trial.rerun].train;
        let (mut all, mut of_material) = (Vec::new(), HashMap::<_, Vec<f64>>::new());
        for (surface, value) in tables.measured(&trial.property, training) {
            all.push(value);
            let alike = of_material.entry(material(surface)).or_default();
            alike.push(value);
        }
        let all = mean(&all);
        let of_material = of_material.iter();
        let of_material: HashMap<_, _> = of_material.map(|(name, of)| (*name, mean(of))).collect();
        let estimate = |&surface: &usize| match of_material.get(material(surface)) {
            Some(&value) if by_label => value,
            // That of all where no training surface is of the material.
            _ => all,
        };
        Ok(Outcome {
            estimate: surfaces.iter().map(estimate).collect(),
            ..outcome
        })
    };
    trials.iter().map(outcome).collect::<Result<_>>().map(Some)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
