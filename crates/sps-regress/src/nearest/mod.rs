//! The nearest neighbour in the embedding: a floor that learns nothing.

mod store;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use rayon::prelude::*;

use crate::data::Embeddings;
use crate::error::Result;
use crate::groups::{fit_groups, sharing};
use crate::plan::{Plan, TrainingData, Trial};
use crate::regressor::{Estimates, check_fits};

/// Sums that a distance is added up in side by side.
const LANES: usize = 16;

/// The reading of the training surface whose embedding is nearest (Fix and Hodges 1951), by
/// Euclidean distance over all views side by side, each block of embeddings scaled to a mean variance of 1.
/// Only surfaces with a reading of the property
/// count; of equally near ones, that of the lowest index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Nearest;

impl Nearest {
    /// Keeps the training surfaces of every trial of the plan.
    ///
    /// # Errors
    ///
    /// A plan that does not fit the data, a trial without fixed views, a property without a
    /// training reading.
    pub fn train(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<TrainedNearests> {
        let nearests = fit_groups(data, plan, |group| {
            let embeddings = Arc::new(group.embeddings.clone());
            let nearests = group.jobs.iter().map(|job| TrainedNearest {
                trial: job.trial.clone(),
                embeddings: Arc::clone(&embeddings),
                values: job.values.clone(),
            });
            Ok(nearests.collect())
        })?;
        Ok(TrainedNearests { nearests })
    }
}

/// The training surfaces of one trial.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainedNearest {
    trial: Trial,
    /// `(surfaces, views, width)`, shared by the trials on the same views of the same surfaces.
    embeddings: Arc<Embeddings>,
    /// One reading per surface.
    values: Vec<f64>,
}

impl TrainedNearest {
    /// What it was kept for.
    pub fn trial(&self) -> &Trial {
        &self.trial
    }
}

/// The training surfaces of a plan's trials.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainedNearests {
    nearests: Vec<TrainedNearest>,
}

impl TrainedNearests {
    /// Each trial's, in the order of the plan.
    pub fn nearests(&self) -> &[TrainedNearest] {
        &self.nearests
    }

    /// Those for which `keep` says so.
    #[must_use]
    pub fn filter(&self, keep: impl Fn(&Trial) -> bool) -> Self {
        let kept = self.nearests.iter().filter(|one| keep(&one.trial));
        Self {
            nearests: kept.cloned().collect(),
        }
    }

    /// Multiply-adds to estimate one surface from its embeddings, all trials together; those on
    /// the same surfaces share the distances to them.
    pub fn multiply_adds(&self) -> u64 {
        let shared = sharing(self.nearests.iter().map(|one| &one.embeddings));
        let distances = |of: &Embeddings| (of.surfaces() * of.views() * of.width()) as u64;
        shared
            .iter()
            .map(|(embeddings, _)| distances(embeddings))
            .sum()
    }

    /// The estimates of every trial for every surface, in measured units. The views of
    /// `embeddings` are the ones to use, in the order of the trial's views.
    ///
    /// # Errors
    ///
    /// Embeddings of another width or number of views than were kept.
    pub fn predict(&self, embeddings: &Embeddings) -> Result<Vec<Estimates>> {
        let estimates = |one: &TrainedNearest| Estimates {
            property: one.trial.property.clone(),
            rerun: one.trial.rerun,
            values: Vec::new(),
        };
        let mut all: Vec<Estimates> = self.nearests.iter().map(estimates).collect();
        for (training, places) in sharing(self.nearests.iter().map(|one| &one.embeddings)) {
            check_fits("embeddings for the nearest neighbour", embeddings, training)?;
            let factors = training.balance();
            let [training, embeddings] = [training, embeddings].map(|all| all.scaled(&factors));
            let nearest: Vec<usize> = (0..embeddings.surfaces())
                .into_par_iter()
                .map(|surface| nearest(&training, embeddings.surface(surface)))
                .collect();
            for at in places {
                let values = &self.nearests[at].values;
                all[at].values = nearest.iter().map(|&surface| values[surface]).collect();
            }
        }
        Ok(all)
    }
}

/// The surface at the least distance; the first of several.
fn nearest(training: &Embeddings, features: &[f32]) -> usize {
    let distances = (0..training.surfaces()).map(|surface| {
        (
            surface,
            squared_distance(training.surface(surface), features),
        )
    });
    let least = distances.min_by(|(_, a), (_, b)| a.total_cmp(b));
    least.map_or(0, |(surface, _)| surface)
}

/// The square of the Euclidean distance of as many values as both have; the same whichever comes first.
pub fn squared_distance(a: &[f32], b: &[f32]) -> f32 {
    let (a, rest_of_a) = a.as_chunks::<LANES>();
    let (b, rest_of_b) = b.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += (a - b) * (a - b);
        }
    }
    let rest = rest_of_a
        .iter()
        .zip(rest_of_b)
        .map(|(a, b)| (a - b) * (a - b));
    sums.iter().sum::<f32>() + rest.sum::<f32>()
}
