//! The nearest neighbour in the embedding: a floor that learns nothing.

mod store;

use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};
use sps_base::parallel;

use crate::data::Embeddings;
use crate::error::Result;
use crate::fitted::{Fitted, FittedModel};
use crate::groups::{fit_groups, sharing};
use crate::plan::{Plan, TrainingData, Trial};
use crate::regressor::check_fits;

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
        Ok(Fitted(nearests))
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

/// The training surfaces of a plan's trials.
pub type TrainedNearests = Fitted<TrainedNearest>;

impl FittedModel for TrainedNearest {
    const KIND: &'static str = "nearest";

    fn trial(&self) -> &Trial {
        &self.trial
    }

    fn estimate(models: &[Self], embeddings: &Embeddings) -> Result<Vec<Vec<f64>>> {
        let mut all = vec![Vec::new(); models.len()];
        for (training, places) in sharing(models.iter().map(|one| &one.embeddings)) {
            check_fits("embeddings for the nearest neighbour", embeddings, training)?;
            let factors = training.balance();
            let [training, embeddings] = [training, embeddings].map(|all| all.scaled(&factors));
            let nearest = |at| nearest(&training, embeddings.surface(at));
            let nearest = parallel::map(0..embeddings.surfaces(), nearest);
            for at in places {
                let values = &models[at].values;
                all[at] = nearest.iter().map(|&surface| values[surface]).collect();
            }
        }
        Ok(all)
    }

    /// Trials on the same surfaces share the distances to them.
    fn multiply_adds(models: &[Self]) -> u64 {
        let shared = sharing(models.iter().map(|one| &one.embeddings));
        let distances = shared.iter().map(|(of, _)| of.values().len() as u64);
        distances.sum()
    }

    fn to_bytes(models: &[Self]) -> Result<Vec<u8>> {
        store::to_bytes(models)
    }

    fn from_bytes(bytes: &[u8]) -> Result<Vec<Self>> {
        store::from_bytes(bytes)
    }
}

/// The surface at the least distance; the first of several.
fn nearest(training: &Embeddings, features: &[f32]) -> usize {
    let surfaces = 0..training.surfaces();
    let distances = surfaces.map(|surface| squared_distance(training.surface(surface), features));
    let least = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
    least.map_or(0, |(surface, _)| surface)
}

/// The square of the Euclidean distance of as many values as both have; the same whichever comes first. It is computed
/// with the widest vectors of the machine, and has the same bits with any.
pub fn squared_distance(a: &[f32], b: &[f32]) -> f32 {
    Arch::new().dispatch(Distance(a, b))
}

struct Distance<'a>(&'a [f32], &'a [f32]);

impl WithSimd for Distance<'_> {
    type Output = f32;

    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "only what is inlined is compiled with the instructions that were found"
    )]
    fn with_simd<S: Simd>(self, _: S) -> f32 {
        let (a, rest_of_a) = self.0.as_chunks::<LANES>();
        let (b, rest_of_b) = self.1.as_chunks::<LANES>();
        let mut sums = [0.0; LANES];
        for (a, b) in a.iter().zip(b) {
            for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                *sum += (a - b) * (a - b);
            }
        }
        let rest = rest_of_a.iter().zip(rest_of_b);
        let rest = rest.map(|(a, b)| (a - b) * (a - b));
        sums.iter().sum::<f32>() + rest.sum::<f32>()
    }
}
