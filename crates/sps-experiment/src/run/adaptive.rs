//! Looking at one view after the other, until the estimate is sure enough: as a session does with the
//! model that [`Recipe`](sps_estimator::Recipe) fits to the training surfaces.

use std::collections::BTreeMap;
use std::time::Instant;

use anyhow::{Context, Result, anyhow};
use sps_estimator::{Calibration, Fitted, Predictions};

use super::Encodings;
use super::fit::Judge;
use super::trials::TrialSpec;
use crate::config::{Adaptive, Experiment};
use crate::journal::{Outcome, Stop};
use crate::progress::{Progress, ensure_wanted};

/// The trials of a method that stops when it is sure.
pub(super) struct Walking<'a> {
    pub experiment: &'a Experiment,
    pub judge: Judge<'a>,
    pub adaptive: &'a Adaptive,
    pub encodings: &'a Encodings,
    pub trials: &'a [&'a TrialSpec],
}

impl Walking<'_> {
    /// The outcome of each trial; those of a rerun that look at the same views are fitted together.
    pub(super) fn outcomes(&self) -> Result<Vec<Outcome>> {
        let mut together: BTreeMap<(usize, Vec<usize>), Vec<&TrialSpec>> = BTreeMap::new();
        for &trial in self.trials {
            let looked = (trial.rerun, trial.views.shown());
            together.entry(looked).or_default().push(trial);
        }
        let progress = Progress::new(&self.judge.method.label, self.trials.len());
        let mut outcomes = Vec::new();
        for ((rerun, views), trials) in together {
            let begun = Instant::now();
            let fitted = self.fit(rerun, &views, &trials)?;
            let held_out = &self.judge.splits.all[rerun].validation;
            let held_out = self.judge.method.scored_on(held_out);
            let step =
                |count| Ok(fitted.predict(&self.encodings.select(held_out, &views[..count])?)?);
            let steps = fitted
                .steps()
                .map(step)
                .collect::<Result<Vec<Predictions>>>()?;
            let of_trials = trials.iter().enumerate();
            let made =
                of_trials.map(|(at, trial)| self.outcome(trial, at, held_out, &fitted, &steps));
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

    fn fit(&self, rerun: usize, views: &[usize], trials: &[&TrialSpec]) -> Result<Fitted> {
        let Judge {
            method,
            tables,
            splits,
        } = self.judge;
        let calibration = Calibration {
            share: Some(self.adaptive.calibration),
            level: self.adaptive.level,
            seed: self.experiment.seed,
        };
        let wanted = trials.iter().map(|trial| (&trial.property, views.to_vec()));
        let recipe = tables.recipe(method, wanted, calibration)?;
        let examples = tables.examples(&splits.units, &[]);
        let fitted = recipe.fit(&examples, &splits.all[rerun].train, rerun as u64);
        fitted.context("adaptive.calibration")
    }

    /// Of the property at this place of what was fitted, by what each number of views says of `surfaces`.
    fn outcome(
        &self,
        trial: &TrialSpec,
        at: usize,
        surfaces: &[usize],
        fitted: &Fitted,
        steps: &[Predictions],
    ) -> Result<Outcome> {
        let ends = fitted.ends(steps, self.adaptive.width, at..at + 1);
        let deviation = fitted.deviations().nth(at).unwrap_or(1.0);
        let held_out = self.judge.held_out(trial)?;
        let stop = |(place, end): (usize, usize)| {
            let predicted = &steps[end].properties[at];
            let intervals = predicted.intervals.as_ref().map_err(|reason| {
                let property = &trial.property;
                anyhow!("{property}: adaptive.calibration: {reason}")
            });
            let interval = intervals?[place];
            let stop = Stop {
                views: end + 1,
                low: interval.low,
                high: interval.high,
                width: (interval.high - interval.low) / deviation,
            };
            Ok((predicted.values[place], stop))
        };
        let mut measured = held_out.surfaces.iter().peekable();
        let ends = ends.into_iter().enumerate();
        let ends = ends.filter(|(at, _)| measured.next_if_eq(&&surfaces[*at]).is_some());
        let stops = ends.map(stop);
        let (estimates, stops) = stops.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        Ok(Outcome {
            stops,
            ..self.judge.outcome(trial, held_out, estimates)
        })
    }
}
