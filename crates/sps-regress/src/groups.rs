//! Trials that are fitted together, because they see the same views of the same surfaces.

use std::collections::BTreeMap;
use std::sync::Arc;

use sps_base::parallel;

use crate::data::{Embeddings, Readings};
use crate::error::{Error, Result};
use crate::left_out::LeftOut;
use crate::plan::{Plan, TrainingData, Trial, Views};

/// A trial of a plan, with its training values.
pub(crate) struct Job<'a> {
    at: usize,
    pub(crate) trial: &'a Trial,
    /// One reading per surface of its group.
    pub(crate) values: Vec<f64>,
}

/// The trials on the same views of the same surfaces.
pub(crate) struct Group<'a> {
    /// `(surfaces, views, width)`, the training surfaces in ascending order.
    pub(crate) embeddings: Embeddings,
    pub(crate) left_out: LeftOut,
    surfaces: Vec<usize>,
    readings: &'a Readings,
    /// In the order of the plan.
    pub(crate) jobs: Vec<Job<'a>>,
}

impl Group<'_> {
    /// The values of each property that was read of every surface of the group, whether the plan asks for it or not.
    pub(crate) fn read_of_all(&self) -> Vec<Vec<f64>> {
        let columns = 0..self.readings.properties().len();
        let values = |column| {
            let surfaces = self.surfaces.iter();
            surfaces
                .map(move |&at| self.readings.get(at, column))
                .collect()
        };
        columns.filter_map(values).collect()
    }
}

/// What `fit` makes of each group, a model for each of its jobs, in the order of the plan's trials.
///
/// # Errors
/// A plan that does not fit the data, a trial without fixed views, a property without a training
/// reading, what `fit` says.
pub(crate) fn fit_groups<T: Send>(
    data: &TrainingData<'_>,
    plan: &Plan,
    fit: impl Fn(&Group<'_>) -> Result<Vec<T>> + Sync,
) -> Result<Vec<T>> {
    plan.check(None, data)?;
    let mut groups: BTreeMap<(&[usize], Vec<usize>), Vec<Job<'_>>> = BTreeMap::new();
    for (at, trial) in plan.trials.iter().enumerate() {
        let Views::Fixed(views) = &trial.views else {
            let what = "views of a trial";
            return Err(Error::input(what, "ones that change", "fixed ones"));
        };
        let (surfaces, values) = plan.readings(data, trial).into_iter().unzip();
        let job = Job { at, trial, values };
        groups.entry((views, surfaces)).or_default().push(job);
    }
    let fitted = parallel::map(groups, |((views, surfaces), jobs)| {
        let group = Group {
            embeddings: data.embeddings.select(&surfaces, views)?,
            left_out: LeftOut::of(&surfaces, data.units),
            surfaces,
            readings: data.readings,
            jobs,
        };
        let models = fit(&group)?;
        Ok(group.jobs.iter().map(|job| job.at).zip(models).collect())
    });
    let fitted: Vec<Vec<(usize, T)>> = fitted.into_iter().collect::<Result<_>>()?;
    let mut models: Vec<(usize, T)> = fitted.into_iter().flatten().collect();
    models.sort_by_key(|(at, _)| *at);
    Ok(models.into_iter().map(|(_, model)| model).collect())
}

/// The models that share what `shared` points to, by their place among all, in the order of the
/// first of each.
pub(crate) fn sharing<'a, T>(
    shared: impl Iterator<Item = &'a Arc<T>>,
) -> Vec<(&'a Arc<T>, Vec<usize>)> {
    let mut all: Vec<(&Arc<T>, Vec<usize>)> = Vec::new();
    for (at, one) in shared.enumerate() {
        match all.iter_mut().find(|(other, _)| Arc::ptr_eq(other, one)) {
            Some((_, places)) => places.push(at),
            None => all.push((one, vec![at])),
        }
    }
    all
}
