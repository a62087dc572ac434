//! Looking at one view after the other, until the estimate is sure enough: as a session does with the
//! model that [`Recipe`](sps_estimator::Recipe) fits to the training surfaces.

use std::collections::BTreeMap;
use std::time::Instant;

use anyhow::{Context, Result, anyhow};
use sps_estimator::{Calibration, Fitted, Predictions};
use sps_metrics::PredictionInterval;

use super::fit::Judge;
use super::trials::TrialSpec;
use crate::config::Adaptive;
use crate::journal::{Outcome, Stop};
use crate::progress::{Progress, ensure_wanted};

/// The outcomes of the trials of a method that stops when it is sure; those of a rerun that look at the
/// same views are fitted together.
pub(super) fn outcomes(
    judge: &Judge<'_>,
    adaptive: &Adaptive,
    trials: &[&TrialSpec],
) -> Result<Vec<Outcome>> {
    let mut together: BTreeMap<(usize, Vec<usize>), Vec<&TrialSpec>> = BTreeMap::new();
    for &trial in trials {
        let looked = (trial.rerun, trial.views.shown());
        together.entry(looked).or_default().push(trial);
    }
    let progress = Progress::new(&judge.method.label, trials.len());
    let mut outcomes = Vec::new();
    for ((rerun, views), trials) in together {
        let begun = Instant::now();
        let fitted = fitted(judge, adaptive, (rerun, &views), &trials)?;
        let held_out = &judge.splits.all[rerun].validation;
        let held_out = judge.method.scored_on(held_out);
        let steps = fitted.steps().map(|count| {
            let seen = judge.encodings.select(held_out, &views[..count])?;
            Ok(fitted.predict(&seen)?)
        });
        let steps = steps.collect::<Result<Vec<Predictions>>>()?;
        let made = trials.iter().enumerate().map(|(at, trial)| {
            let ends = fitted.ends(&steps, adaptive.width, at..at + 1);
            let deviation = fitted.deviations().nth(at).unwrap_or(1.0);
            outcome(judge, trial, (at, deviation), (held_out, &ends), &steps)
        });
        let made = made.collect::<Result<Vec<_>>>()?;
        let train_seconds = begun.elapsed().as_secs_f64() / made.len() as f64;
        progress.advance(made.len());
        outcomes.extend(made.into_iter().map(|outcome| Outcome {
            train_seconds,
            ..outcome
        }));
        ensure_wanted()?;
    }
    Ok(outcomes)
}

fn fitted(
    judge: &Judge<'_>,
    adaptive: &Adaptive,
    (rerun, views): (usize, &[usize]),
    trials: &[&TrialSpec],
) -> Result<Fitted> {
    let calibration = Calibration {
        share: Some(adaptive.calibration),
        level: adaptive.level,
        seed: judge.experiment.seed,
    };
    let wanted = trials.iter().map(|trial| (&trial.property, views.to_vec()));
    let recipe = judge.tables().recipe(judge.method, wanted, calibration)?;
    let examples = judge.tables().examples(&judge.splits.units, &[]);
    let fitted = recipe.fit(&examples, &judge.splits.all[rerun].train, rerun as u64);
    fitted.context("adaptive.calibration")
}

/// Of the property at this place of each step, whose looks at `surfaces` end at these steps.
fn outcome(
    judge: &Judge<'_>,
    trial: &TrialSpec,
    (at, deviation): (usize, f64),
    (surfaces, ends): (&[usize], &[usize]),
    steps: &[Predictions],
) -> Result<Outcome> {
    let (measured, mut outcome) = judge.held_out(trial)?;
    let mut measured = measured.iter().peekable();
    for (place, (surface, &end)) in surfaces.iter().zip(ends).enumerate() {
        if measured.next_if_eq(&surface).is_none() {
            continue;
        }
        let predicted = &steps[end].properties[at];
        let intervals = predicted.intervals.as_ref().map_err(|reason| {
            let property = &trial.property;
            anyhow!("{property}: adaptive.calibration: {reason}")
        })?;
        let PredictionInterval { low, high } = intervals[place];
        outcome.estimate.push(predicted.values[place]);
        outcome.stops.push(Stop {
            views: end + 1,
            low,
            high,
            width: Some((high - low) / deviation),
        });
    }
    Ok(outcome)
}
