//! A trial with all that it needs from the tables, and the stacks in which trials are trained.

use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::prelude::*;
use sps_regress::{Embeddings, Plan, Rerun, Standardiser, TrainingData, Trial, Views};

use super::config::HeadConfig;
use super::input::InputStatistics;
use super::network::Dims;
use crate::error::Result;
use crate::labels::{self, Labels};

/// The most trials in one stack, which spreads the cost of a tensor operation over them.
const WIDEST_STACK: usize = 8;
/// The most parameters in one stack: with gradient and moments they should stay in a core's cache.
const LARGEST_STACK: usize = 250_000;

pub(super) struct Job<'a> {
    pub(super) trial: &'a Trial,
    pub(super) training: Part,
    /// Empty without early stopping.
    pub(super) validation: Part,
    pub(super) statistics: Arc<InputStatistics>,
    pub(super) target: Standardiser,
    /// Of the training surfaces.
    pub(super) labels: Option<Arc<Labels>>,
}

/// Some surfaces of a trial.
pub(super) struct Part {
    /// Ascending.
    pub(super) surfaces: Arc<Vec<usize>>,
    /// The standardised reading of each.
    pub(super) tactile: Vec<Option<f32>>,
}

impl Part {
    /// How many surfaces it has.
    pub(super) fn len(&self) -> usize {
        self.surfaces.len()
    }

    fn new(
        surfaces: &Arc<Vec<usize>>,
        reading: impl Fn(usize) -> Option<f64>,
        target: Standardiser,
    ) -> Self {
        let standard = |&s: &usize| reading(s).map(|t| target.standardise(t) as f32);
        Self {
            tactile: surfaces.iter().map(standard).collect(),
            surfaces: Arc::clone(surfaces),
        }
    }
}

impl Job<'_> {
    pub(super) fn classes(&self) -> usize {
        self.labels.as_ref().map_or(0, |labels| labels.classes)
    }

    pub(super) fn dims(&self, config: &HeadConfig, embeddings: &Embeddings) -> Dims {
        Dims {
            slots: config.input.slots(),
            width: embeddings.width(),
            classes: self.classes(),
        }
    }
}

/// The jobs of a checked plan, in its order.
pub(super) fn prepare<'a>(
    config: &HeadConfig,
    data: &TrainingData<'_>,
    plan: &'a Plan,
) -> Result<Vec<Job<'a>>> {
    let shared = Shared::new(config, data, plan)?;
    let jobs = plan.trials.iter().filter_map(|trial| {
        let rerun = shared.reruns.get(&trial.rerun)?;
        let column = data.readings.column(&trial.property)?;
        let reading = |surface| data.readings.get(surface, column);
        let target = Standardiser::of(rerun.training.iter().filter_map(|&s| reading(s)))?;
        Some(Job {
            trial,
            training: Part::new(&rerun.training, reading, target),
            validation: Part::new(&rerun.validation, reading, target),
            statistics: Arc::clone(shared.statistics.get(&(trial.rerun, &trial.views))?),
            target,
            labels: rerun.labels.clone(),
        })
    });
    Ok(jobs.collect())
}

/// What several trials have in common, computed once.
struct Shared<'a> {
    reruns: BTreeMap<u64, SharedRerun>,
    statistics: BTreeMap<(u64, &'a Views), Arc<InputStatistics>>,
}

struct SharedRerun {
    training: Arc<Vec<usize>>,
    validation: Arc<Vec<usize>>,
    labels: Option<Arc<Labels>>,
}

impl<'a> Shared<'a> {
    fn new(config: &HeadConfig, data: &TrainingData<'_>, plan: &'a Plan) -> Result<Self> {
        let is_wanted = |rerun: &&Rerun| plan.trials.iter().any(|t| t.rerun == rerun.number);
        let wanted: Vec<_> = plan.reruns.iter().filter(is_wanted).collect();
        let reruns: Vec<Result<_>> = wanted
            .into_par_iter()
            .map(|rerun| {
                let training = ascending(&rerun.training);
                let validation = match config.early_stopping {
                    Some(_) => ascending(&rerun.validation),
                    None => Arc::default(),
                };
                let labels = config.model.labels();
                let labels = labels
                    .map(|source| labels::label(source, data, &training, plan.seed, rerun.number));
                let shared = SharedRerun {
                    labels: labels.transpose()?.map(Arc::new),
                    training,
                    validation,
                };
                Ok((rerun.number, shared))
            })
            .collect();
        let reruns: BTreeMap<_, _> = reruns.into_iter().collect::<Result<_>>()?;
        let mut statistics = BTreeMap::new();
        for Trial { rerun, views, .. } in &plan.trials {
            if let Some(SharedRerun { training, .. }) = reruns.get(rerun) {
                statistics.entry((*rerun, views)).or_insert_with(|| {
                    let (scale, input) = (config.scale, &config.input);
                    let embeddings = data.embeddings;
                    InputStatistics::new(scale, input, embeddings, training, views).into()
                });
            }
        }
        Ok(Self { reruns, statistics })
    }
}

fn ascending(surfaces: &[usize]) -> Arc<Vec<usize>> {
    let mut surfaces = surfaces.to_vec();
    surfaces.sort_unstable();
    Arc::new(surfaces)
}

/// Groups the jobs (by index) into stacks of equal shape.
///
/// How they are grouped decides the speed alone: no bit of a trial depends on its stack.
pub(super) fn stacks<'a>(
    jobs: &[Job<'a>],
    parameters: impl Fn(&Job<'a>) -> usize,
    threads: usize,
) -> Vec<Vec<usize>> {
    let mut groups = BTreeMap::<_, Vec<usize>>::new();
    for (index, job) in jobs.iter().enumerate() {
        let shape = (job.training.len(), job.validation.len(), job.classes());
        groups.entry(shape).or_default().push(index);
    }
    let per_thread = jobs.len().div_ceil(threads.max(1)).max(1);
    let mut stacks = Vec::new();
    for group in groups.values() {
        let fitting = LARGEST_STACK / parameters(&jobs[group[0]]).max(1);
        let widest = fitting.clamp(1, WIDEST_STACK).min(per_thread);
        // Stacks of nearly equal size, so that no thread is left with a rest.
        let count = group.len().div_ceil(widest);
        let size = group.len().div_ceil(count);
        stacks.extend(group.chunks(size).map(<[usize]>::to_vec));
    }
    stacks
}
