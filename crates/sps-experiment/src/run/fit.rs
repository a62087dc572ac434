//! Fitting a method's trials, each outcome on disk as soon as it is there.

use std::collections::{BTreeMap, HashSet};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use anyhow::{Context, Result};
use sps_dataset::Units;
use sps_estimator::Regression;
use sps_models::heads::{Observer, TrainedHead, TrainedHeads};
use sps_regress::{DivergedTrial, FittedRegressor, Plan, Trial};
use tracing::warn;

use super::trials::{TrialSpec, plan};
use super::{Encodings, Splits, Tables, adaptive, floors};
use crate::config::{Experiment, Method};
use crate::journal::{Journal, Outcome};
use crate::progress::{Progress, ensure_wanted};
use crate::training::EventFile;

/// The folder of the courses of networks' trainings, in that of a run.
const COURSES: &str = "tensorboard";

/// Fits the method to the trials of a plan; those that come to nothing have no model.
pub(super) fn fit_some(
    method: &Method,
    (tables, units): (&Tables, &Units),
    plan: &Plan,
    observer: &dyn Observer,
) -> Result<Box<dyn FittedRegressor>> {
    let fitted = method.estimator.regression();
    let fitted = fitted.context("a method that is not trained")?;
    Ok(fitted.fit_some(&tables.training_data(units), units, plan, observer)?)
}

/// Turns fitted models into outcomes and writes them down.
struct Recorder<'a> {
    judge: Judge<'a>,
    trials: &'a [&'a TrialSpec],
    progress: Progress,
    /// Where the courses of networks' trainings go.
    courses: PathBuf,
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
        let course = |trained: &Trial| {
            let head = heads.heads().iter().find(|head| head.trial() == trained);
            let history = head.map_or(&[][..], TrainedHead::history);
            history.iter().map(|losses| losses.estimation).collect()
        };
        let recorded = self.record(heads, course);
        if let Err(error) = recorded.and_then(|()| self.keep_courses(heads)) {
            self.state().failed.get_or_insert(error);
        }
    }

    fn stops(&self) -> bool {
        self.progress.is_over() || self.state().failed.is_some()
    }
}

impl<'a> Recorder<'a> {
    /// Writes down for TensorBoard how networks of the first rerun were trained; those of others are
    /// much alike.
    fn keep_courses(&self, heads: &TrainedHeads) -> Result<()> {
        for head in heads.heads().iter().filter(|head| head.trial().rerun == 0) {
            EventFile::create(&self.courses.join(&head.trial().property))?.head(head)?;
        }
        Ok(())
    }

    /// Writes down what models estimate; `course` says how the network of a trial was trained.
    fn record(
        &self,
        models: &dyn FittedRegressor,
        course: impl Fn(&Trial) -> Vec<f64>,
    ) -> Result<()> {
        let mut outcomes = self.outcomes(models, course)?;
        for one in models.diverged() {
            outcomes.push(self.failure(one)?);
        }
        let mut state = self.state();
        let seconds = state.since.elapsed().as_secs_f64() / outcomes.len().max(1) as f64;
        for outcome in &mut outcomes {
            outcome.train_seconds = seconds;
        }
        self.progress.advance(outcomes.len());
        state.journal.append(outcomes)?;
        state.since = Instant::now();
        Ok(())
    }

    fn state(&self) -> MutexGuard<'_, State<'a>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The outcome of each model: its estimates for the surfaces held out that were measured.
    /// Models that look at the same surfaces and views are asked together.
    fn outcomes(
        &self,
        models: &dyn FittedRegressor,
        course: impl Fn(&Trial) -> Vec<f64>,
    ) -> Result<Vec<Outcome>> {
        let mut alike: BTreeMap<Looked<'_>, Vec<(&TrialSpec, Outcome)>> = BTreeMap::new();
        for trained in models.trials() {
            let spec = self.spec(trained)?;
            let (surfaces, outcome) = self.judge.held_out(spec)?;
            let key = (surfaces, spec.views.fillings.as_slice());
            alike.entry(key).or_default().push((spec, outcome));
        }
        let mut outcomes = Vec::new();
        for ((surfaces, fillings), specs) in alike {
            let some =
                models.filtered(&|trained| specs.iter().any(|(spec, _)| is_of(spec, trained)));
            let mut estimates = self.estimates(some.as_ref(), fillings, &surfaces)?;
            for (spec, outcome) in specs {
                let trials = some.trials();
                let place = trials.iter().position(|trained| is_of(spec, trained));
                let place = place.context("no model")?;
                outcomes.push(Outcome {
                    estimate: std::mem::take(&mut estimates[place]),
                    course: course(trials[place]),
                    ..outcome
                });
            }
        }
        Ok(outcomes)
    }

    fn failure(&self, diverged: &DivergedTrial) -> Result<Outcome> {
        let DivergedTrial { trial, reason } = diverged;
        let (judge, spec) = (&self.judge, self.spec(trial)?);
        let (label, property, rerun) = (&judge.method.label, &trial.property, trial.rerun);
        warn!("{label}, {property}, rerun {rerun}: {reason}");
        let (_, outcome) = judge.held_out(spec)?;
        Ok(Outcome {
            surfaces: Vec::new(),
            truth: Vec::new(),
            failed: Some(reason.clone()),
            ..outcome
        })
    }

    fn spec(&self, trained: &Trial) -> Result<&TrialSpec> {
        let spec = self.trials.iter().find(|spec| is_of(spec, trained));
        spec.copied().context("a trial that was not planned")
    }

    /// The mean over the fillings of the models' slots: for each model, of each of `surfaces`.
    fn estimates(
        &self,
        models: &dyn FittedRegressor,
        fillings: &[Vec<usize>],
        surfaces: &[usize],
    ) -> Result<Vec<Vec<f64>>> {
        let mut sums = vec![vec![0.0; surfaces.len()]; models.trials().len()];
        for views in fillings {
            let embeddings = self.judge.encodings.select(surfaces, views)?;
            for (sums, estimates) in sums.iter_mut().zip(models.predict(&embeddings)?) {
                for (sum, value) in sums.iter_mut().zip(estimates.values) {
                    *sum += value / fillings.len() as f64;
                }
            }
        }
        Ok(sums)
    }
}

fn folder_name(id: &str) -> String {
    id.trim_start_matches('.').replace(['/', '\\'], "-")
}

/// Surfaces, and the fillings of the slots with their views.
type Looked<'a> = (Vec<usize>, &'a [Vec<usize>]);

fn is_of(spec: &TrialSpec, trained: &Trial) -> bool {
    spec.rerun as u64 == trained.rerun && spec.property.code() == trained.property
}

/// A method whose trials are run, and outcomes made of what it estimates.
#[derive(Clone, Copy)]
pub(super) struct Judge<'a> {
    pub experiment: &'a Experiment,
    pub method: &'a Method,
    pub encodings: &'a Encodings,
    pub splits: &'a Splits,
}

impl<'a> Judge<'a> {
    /// Runs those of the trials that the journal lacks.
    pub(super) fn run_missing(
        self,
        trials: &[TrialSpec],
        journal: &mut Journal<Outcome>,
    ) -> Result<()> {
        let (experiment, method) = (self.experiment, self.method);
        let mut keys = HashSet::new();
        let mut missing: Vec<&TrialSpec> = trials.iter().collect();
        missing.retain(|trial| journal.get(&trial.key).is_none() && keys.insert(&trial.key));
        let Some(first) = missing.first() else {
            return Ok(());
        };
        ensure_wanted()?;
        let (id, property, rerun) = (&method.id, &first.property, first.rerun);
        let what = format!("method `{id}`, {property}, rerun {rerun}");
        experiment.work.ensure_fits(&what)?;
        if let Some(outcomes) = floors::outcomes(&self, &missing)? {
            return journal.append(outcomes);
        }
        let named = || format!("method `{id}`");
        if let Some(adaptive) = &method.adaptive {
            let outcomes = adaptive::outcomes(&self, adaptive, &missing);
            return journal.append(outcomes.with_context(named)?);
        }
        let trials = missing.iter().map(|trial| trial.trial());
        let plan = plan(experiment.seed, &self.splits.all, trials);
        let recorder = Recorder {
            judge: self,
            trials: &missing,
            progress: Progress::new(&method.label, missing.len()),
            courses: journal.beside(COURSES).join(folder_name(id)),
            state: Mutex::new(State {
                journal,
                since: Instant::now(),
                failed: None,
            }),
        };
        let data = (self.tables(), &self.splits.units);
        let fitted = fit_some(method, data, &plan, &recorder);
        // Networks were recorded as they were finished.
        if let Ok(fitted) = &fitted
            && !matches!(method.estimator.regression(), Some(Regression::Head(_)))
        {
            recorder.record(fitted.as_ref(), |_| Vec::new())?;
        }
        // A training that was stopped says less than what stopped it.
        recorder.state().failed.take().map_or(Ok(()), Err)?;
        ensure_wanted()?;
        fitted.with_context(named)?;
        Ok(())
    }

    pub(super) fn tables(&self) -> &'a Tables {
        &self.encodings.stage.tables
    }

    /// The surfaces held out that were measured, and the outcome of the trial but for its estimates.
    pub(super) fn held_out(&self, trial: &TrialSpec) -> Result<(Vec<usize>, Outcome)> {
        let (tables, split) = (self.tables(), &self.splits.all[trial.rerun]);
        let training = tables.measured(&trial.property, &split.train);
        let training: Vec<f64> = training.into_iter().map(|(_, value)| value).collect();
        let scored_on = self.method.scored_on(&split.validation);
        let measured = tables.measured(&trial.property, scored_on);
        let (surfaces, truth): (Vec<usize>, Vec<f64>) = measured.into_iter().unzip();
        let names = surfaces.iter();
        let outcome = Outcome {
            key: trial.key.clone(),
            method: self.method.id.clone(),
            property: trial.property.to_string(),
            rerun: trial.rerun,
            training_mean: sps_metrics::TrainingMean::of(&training)?.get(),
            surfaces: names.map(|&s| tables.surfaces[s].id.clone()).collect(),
            truth,
            views: tables.shown(&trial.views.shown()),
            ..Outcome::default()
        };
        Ok((surfaces, outcome))
    }
}
