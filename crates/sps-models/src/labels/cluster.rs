use std::collections::HashSet;

use linfa::DatasetBase;
use linfa::traits::{Fit, Predict};
use linfa_clustering::{KMeans, KMeansInit};
use ndarray::Array2;

use super::LabelError;
use crate::rng;

/// Restarts, of which the one with the least inertia is kept.
const RESTARTS: usize = 10;
/// The centroids rest when they move by less than this (the points have unit variance).
const TOLERANCE: f64 = 1e-7;
const MAX_ITERATIONS: u64 = 1000;

/// The cluster of each row of `points`, and how many clusters there are.
///
/// k-means with k-means++ starts (the parallel start of linfa depends on the number of threads).
/// `clusters` is reduced to the number of distinct points.
pub(super) fn cluster(
    points: Array2<f64>,
    clusters: usize,
    seed: u64,
    rerun: u64,
) -> Result<(Vec<usize>, usize), LabelError> {
    let clusters = clusters.min(distinct(&points));
    let points = DatasetBase::from(points);
    let rng = rng::stream_for_linfa(seed, "labels/k-means", rerun);
    let model = KMeans::params_with_rng(clusters, rng)
        .init_method(KMeansInit::KMeansPlusPlus)
        .n_runs(RESTARTS)
        .tolerance(TOLERANCE)
        .max_n_iterations(MAX_ITERATIONS)
        .fit(&points)
        .map_err(|source| LabelError::Clustering(source.to_string()))?;
    let of = model.predict(points.records());
    Ok((of.to_vec(), clusters))
}

fn distinct(points: &Array2<f64>) -> usize {
    points
        .rows()
        .into_iter()
        // Adding zero makes the two zeros one.
        .map(|row| row.iter().map(|v| (v + 0.0).to_bits()).collect::<Vec<_>>())
        .collect::<HashSet<_>>()
        .len()
}
