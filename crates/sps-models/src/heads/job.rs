//! A trial with all that it needs from the tables, and the stacks in which trials are trained.

use std::collections::BTreeMap;
use std::sync::Arc;

use sps_base::parallel;
use sps_regress::{Embeddings, Plan, Rerun, Standardiser, TrainingData, Trial};

use super::config::HeadConfig;
use super::input::InputStatistics;
use super::network::{Dims, specs};
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
    let is_wanted = |rerun: &&Rerun| plan.trials.iter().any(|t| t.rerun == rerun.number);
    let wanted: Vec<_> = plan.reruns.iter().filter(is_wanted).collect();
    let shared = |rerun: &Rerun| Ok((rerun.number, Shared::new(config, data, plan.seed, rerun)?));
    let reruns = parallel::map(wanted, shared).into_iter();
    let reruns: BTreeMap<_, _> = reruns.collect::<Result<_>>()?;
    let mut statistics = BTreeMap::new();
    let jobs = plan.trials.iter().filter_map(|trial| {
        let rerun = reruns.get(&trial.rerun)?;
        let column = data.readings.column(&trial.property)?;
        let reading = |surface| data.readings.get(surface, column);
        let target = Standardiser::of(rerun.training.iter().filter_map(|&s| reading(s)))?;
        let (embeddings, training) = (data.embeddings, &rerun.training);
        let of_views = || InputStatistics::new(config, embeddings, training, &trial.views).into();
        let statistics = statistics.entry((trial.rerun, &trial.views));
        Some(Job {
            trial,
            training: Part::new(training, reading, target),
            validation: Part::new(&rerun.validation, reading, target),
            statistics: Arc::clone(statistics.or_insert_with(of_views)),
            target,
            labels: rerun.labels.clone(),
        })
    });
    Ok(jobs.collect())
}

/// What the trials of a rerun have in common, computed once.
struct Shared {
    training: Arc<Vec<usize>>,
    validation: Arc<Vec<usize>>,
    labels: Option<Arc<Labels>>,
}

impl Shared {
    fn new(config: &HeadConfig, data: &TrainingData<'_>, seed: u64, rerun: &Rerun) -> Result<Self> {
        let training = ascending(&rerun.training);
        let label = |source| labels::label(source, data, &training, seed, rerun.number);
        let labels = config.model.labels().map(label).transpose()?;
        Ok(Self {
            labels: labels.map(Arc::new),
            training,
            validation: match config.early_stopping {
                Some(_) => ascending(&rerun.validation),
                None => Arc::default(),
            },
        })
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
pub(super) fn stacks(
    config: &HeadConfig,
    data: &TrainingData<'_>,
    jobs: &[Job<'_>],
) -> Result<Vec<Vec<usize>>> {
    let mut groups = BTreeMap::<_, Vec<usize>>::new();
    for (index, job) in jobs.iter().enumerate() {
        let shape = (job.training.len(), job.validation.len(), job.classes());
        groups.entry(shape).or_default().push(index);
    }
    let threads = rayon::current_num_threads();
    let per_thread = jobs.len().div_ceil(threads.max(1)).max(1);
    let mut stacks = Vec::new();
    for group in groups.values_mut() {
        // Those of a rerun go through the same rows, which are then in a core's cache.
        group.sort_by_key(|&index| jobs[index].trial.rerun);
        let parameters = specs(config, jobs[group[0]].dims(config, data.embeddings))?.into_iter();
        let counts = parameters.map(|spec| spec.shape.into_iter().product::<usize>());
        let fitting = LARGEST_STACK / counts.sum::<usize>().max(1);
        let widest = fitting.clamp(1, WIDEST_STACK).min(per_thread);
        // Stacks of nearly equal size, so that no thread is left with a rest.
        let count = group.len().div_ceil(widest);
        let size = group.len().div_ceil(count);
        stacks.extend(group.chunks(size).map(<[usize]>::to_vec));
    }
    Ok(stacks)
}
