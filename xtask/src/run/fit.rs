//! Fitting a method's trials, each outcome on disk as soon as it is there.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use sps_dataset::Split;
use sps_models::Embeddings;
use sps_models::heads::{
    DivergedTrial, Estimates, Observer, Plan, TrainedHead, TrainedHeads, Trial,
};
use sps_models::ridge::{TrainedRidge, TrainedRidges};

use super::Tables;
use super::adaptive::Walking;
use super::trials::{TrialSpec, plan};
use crate::config::{Estimator, Experiment, Method};
use crate::journal::{Journal, Outcome};
use crate::progress::Progress;

/// Fitted models of one method.
pub(crate) enum Fitted {
    Heads(TrainedHeads),
    Ridges(TrainedRidges),
}

impl Fitted {
    /// The estimates of every model for every surface.
    pub(crate) fn predict(&self, embeddings: &Embeddings) -> sps_models::Result<Vec<Estimates>> {
        match self {
            Self::Heads(heads) => heads.predict(embeddings),
            Self::Ridges(ridges) => ridges.predict(embeddings),
        }
    }
}

impl Fitted {
    /// Multiply-adds to estimate one surface from its embeddings, all models together.
    pub(crate) fn multiply_adds(&self) -> u64 {
        match self {
            Self::Heads(heads) => heads.multiply_adds(),
            Self::Ridges(ridges) => ridges.multiply_adds(),
        }
    }

    /// Each model on its own.
    pub(super) fn each(&self) -> impl Iterator<Item = Self> + '_ {
        let trials: Vec<&Trial> = match self {
            Self::Heads(heads) => heads.heads().iter().map(TrainedHead::trial).collect(),
            Self::Ridges(ridges) => ridges.ridges().iter().map(TrainedRidge::trial).collect(),
        };
        trials.into_iter().map(move |trial| match self {
            Self::Heads(heads) => Self::Heads(heads.filter(|other| other == trial)),
            Self::Ridges(ridges) => Self::Ridges(ridges.filter(|other| other == trial)),
        })
    }

    /// What the first model was trained for.
    fn trial(&self) -> Option<&Trial> {
        match self {
            Self::Heads(heads) => heads.heads().first().map(TrainedHead::trial),
            Self::Ridges(ridges) => ridges.ridges().first().map(TrainedRidge::trial),
        }
    }
}

/// Fits the method to the trials of a plan.
pub(crate) fn fit(
    method: &Method,
    tables: &Tables,
    plan: &Plan,
    observer: &dyn Observer,
) -> Result<Fitted> {
    let data = tables.training_data();
    Ok(match &method.estimator {
        Estimator::Head(head) => {
            let heads = head.train(&data, plan, observer)?;
            if let Some(DivergedTrial { trial, reason }) = heads.diverged().first() {
                bail!(
                    "training {}, rerun {}: {reason}",
                    trial.property,
                    trial.rerun
                );
            }
            Fitted::Heads(heads)
        }
        Estimator::Ridge(ridge) => Fitted::Ridges(ridge.train(&data, plan)?),
    })
}

/// Runs those of the trials that the journal lacks.
pub(crate) fn run_missing(
    experiment: &Experiment,
    method: &Method,
    tables: &Tables,
    splits: &[Split],
    trials: &[TrialSpec],
    journal: &mut Journal<Outcome>,
) -> Result<()> {
    let missing: Vec<&TrialSpec> = trials
        .iter()
        .filter(|trial| journal.get(&trial.key).is_none())
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    if let Some(adaptive) = &method.adaptive {
        let walking = Walking {
            experiment,
            method,
            adaptive,
            tables,
            splits,
            trials: &missing,
        };
        let outcomes = walking.outcomes();
        let named = || format!("method `{}`", method.id);
        return journal.append(outcomes.with_context(named)?);
    }
    let plan = plan(experiment.seed, splits, missing.iter().copied());
    let recorder = Recorder {
        method,
        tables,
        splits,
        trials: &missing,
        progress: Progress::new(&method.label, missing.len()),
        state: Mutex::new(State {
            journal,
            since: Instant::now(),
            failed: None,
        }),
    };
    let fitted =
        fit(method, tables, &plan, &recorder).with_context(|| format!("method `{}`", method.id))?;
    if let Fitted::Ridges(_) = &fitted {
        recorder.record(&fitted);
    }
    match recorder.into_failure() {
        Some(error) => Err(error),
        None => Ok(()),
    }
}

/// Turns fitted models into outcomes and writes them down.
struct Recorder<'a> {
    method: &'a Method,
    tables: &'a Tables,
    splits: &'a [Split],
    trials: &'a [&'a TrialSpec],
    progress: Progress,
    state: Mutex<State<'a>>,
}

struct State<'a> {
    journal: &'a mut Journal<Outcome>,
    /// When the last outcomes were written.
    since: Instant,
    failed: Option<anyhow::Error>,
}

impl Observer for Recorder<'_> {
    fn finished(&self, heads: &TrainedHeads) {
        self.record(&Fitted::Heads(heads.clone()));
    }
}

impl Recorder<'_> {
    fn record(&self, fitted: &Fitted) {
        let outcomes = fitted.each().map(|model| self.outcome(&model)).collect();
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let written = Result::and_then(outcomes, |mut outcomes: Vec<Outcome>| {
            let seconds = state.since.elapsed().as_secs_f64() / outcomes.len().max(1) as f64;
            for outcome in &mut outcomes {
                outcome.train_seconds = seconds;
            }
            self.progress.advance(outcomes.len());
            state.journal.append(outcomes)
        });
        state.since = Instant::now();
        if let Err(error) = written {
            state.failed.get_or_insert(error);
        }
    }

    fn into_failure(self) -> Option<anyhow::Error> {
        let state = self.state.into_inner();
        state.unwrap_or_else(PoisonError::into_inner).failed
    }

    /// The outcome of one model: its estimates for the surfaces held out that were measured.
    fn outcome(&self, model: &Fitted) -> Result<Outcome> {
        let trained = model.trial().context("a model of no trial")?;
        let rerun = trained.rerun as usize;
        let of_model =
            |trial: &&&TrialSpec| trial.rerun == rerun && trial.property.code() == trained.property;
        let trial = self
            .trials
            .iter()
            .find(of_model)
            .context("a trial that was not planned")?;
        let held_out = HeldOut::of(self.tables, trial, &self.splits[rerun])?;
        let estimate = self.estimate(model, &trial.views.fillings, &held_out.surfaces)?;
        Ok(held_out.outcome(self.method, self.tables, trial, estimate))
    }

    /// The mean over the fillings of the model's slots, for each of `surfaces`.
    fn estimate(
        &self,
        model: &Fitted,
        fillings: &[Vec<usize>],
        surfaces: &[usize],
    ) -> Result<Vec<f64>> {
        let mut sums = vec![0.0; surfaces.len()];
        for views in fillings {
            let embeddings = self.tables.embeddings.select(surfaces, views)?;
            let estimates = model.predict(&embeddings)?;
            let values = &estimates.first().context("no estimate")?.values;
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += value;
            }
        }
        let fillings = fillings.len() as f64;
        Ok(sums.into_iter().map(|sum| sum / fillings).collect())
    }
}

/// What a trial is scored on.
pub(super) struct HeldOut {
    training_mean: f64,
    /// Those that were measured.
    pub surfaces: Vec<usize>,
    truth: Vec<f64>,
}

impl HeldOut {
    pub(super) fn of(tables: &Tables, trial: &TrialSpec, split: &Split) -> Result<Self> {
        let training = measured(tables, trial, &split.train)?;
        let training: Vec<f64> = training.into_iter().map(|(_, value)| value).collect();
        let held_out = measured(tables, trial, &split.validation)?;
        let (surfaces, truth) = held_out.into_iter().unzip();
        Ok(Self {
            training_mean: sps_metrics::TrainingMean::of(&training)?.get(),
            surfaces,
            truth,
        })
    }

    /// The outcome with an estimate for each of the surfaces.
    pub(super) fn outcome(
        self,
        method: &Method,
        tables: &Tables,
        trial: &TrialSpec,
        estimate: Vec<f64>,
    ) -> Outcome {
        let names = self.surfaces.iter();
        let shown = trial.views.shown();
        Outcome {
            key: trial.key.clone(),
            method: method.id.clone(),
            property: trial.property.to_string(),
            rerun: trial.rerun,
            training_mean: self.training_mean,
            surfaces: names.map(|&s| tables.surfaces[s].id.clone()).collect(),
            truth: self.truth,
            estimate,
            views: tables.shown(&shown),
            stops: Vec::new(),
            train_seconds: 0.0,
        }
    }
}

/// Those of `surfaces` whose property was measured, with the reading.
pub(super) fn measured(
    tables: &Tables,
    trial: &TrialSpec,
    surfaces: &[usize],
) -> Result<Vec<(usize, f64)>> {
    let readings = &tables.readings;
    let column = readings
        .column(trial.property.code())
        .context("a property that was not measured")?;
    let reading = |&surface: &usize| Some((surface, readings.get(surface, column)?));
    Ok(surfaces.iter().filter_map(reading).collect())
}
