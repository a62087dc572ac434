//! Clusters of tactile values, and of visual ones beside them.

use std::collections::HashSet;

use linfa::DatasetBase;
use linfa::traits::{Fit, Predict};
use linfa_clustering::{KMeans, KMeansInit};
use ndarray::{Array2, ArrayView1, Axis, concatenate};
use rand_chacha_03::ChaCha8Rng;
use rand_chacha_03::rand_core::SeedableRng;
use sps_base::streams;
use sps_regress::{Embeddings, Pca, Readings, Standardiser};

use super::Labels;
use crate::error::{Error, Result};

/// Restarts, of which the one with the least inertia is kept.
const RESTARTS: usize = 10;
/// The centroids rest when they move by less than this (the points have unit variance).
const TOLERANCE: f64 = 1e-7;
const MAX_ITERATIONS: u64 = 1000;

/// The tactile values of the surfaces, and which of them (positions in `training`) the rows are.
pub(super) fn tactile(
    readings: &Readings,
    training: &[usize],
    standardise: bool,
    keep_unmeasured: bool,
) -> Result<(Vec<usize>, Array2<f64>)> {
    let measured = |&surface: &usize| {
        let mut row = readings.row(surface).into_iter().flatten();
        row.any(Option::is_some)
    };
    if !training.iter().any(measured) {
        let expected = "at least one, of a training surface";
        return Err(Error::input("readings for labels", "none", expected));
    }
    let rows = (0..training.len()).filter(|&at| keep_unmeasured || measured(&training[at]));
    let rows: Vec<usize> = rows.collect();
    let mut points = Array2::zeros((rows.len(), readings.properties().len()));
    for (property, mut column) in points.columns_mut().into_iter().enumerate() {
        let values = training.iter().filter_map(|&s| readings.get(s, property));
        let Some(standard) = Standardiser::of(values) else {
            continue; // never measured: the same for all
        };
        for (cell, &at) in column.iter_mut().zip(&rows) {
            let value = readings.get(training[at], property);
            *cell = value.unwrap_or(standard.mean);
            if standardise {
                *cell = standard.standardise(*cell);
            }
        }
    }
    Ok((rows, points))
}

/// The standardised principal components of the middle view of the surfaces.
pub(super) fn visual(
    features: &Embeddings,
    training: &[usize],
    components: usize,
) -> Result<Array2<f64>> {
    let features = features.select(training, &[(features.views() - 1) / 2])?;
    let rows = features.balanced().table();
    let mut table = Pca::fit(rows.view(), components)?.transform(rows.view());
    for mut column in table.columns_mut() {
        // To zero mean and unit variance; a constant column becomes zero.
        if let Some(standard) = Standardiser::of(column.iter().copied()) {
            column.mapv_inplace(|value| standard.standardise(value));
        }
    }
    Ok(table)
}

/// Two tables of equal height side by side.
pub(super) fn beside(left: &Array2<f64>, right: &Array2<f64>) -> Result<Array2<f64>> {
    concatenate(Axis(1), &[left.view(), right.view()])
        .map_err(|error| Error::input("k-means", error, "tables of equal height"))
}

/// Labels of so many surfaces, of which `rows` have the `points`: their clusters.
///
/// k-means with k-means++ starts (the parallel start of linfa depends on the number of threads).
/// `clusters` is reduced to the number of distinct points.
pub(super) fn cluster(
    surfaces: usize,
    rows: &[usize],
    points: Array2<f64>,
    clusters: usize,
    (seed, rerun): (u64, u64),
) -> Result<Labels> {
    let clusters = clusters.min(distinct(&points));
    let points = DatasetBase::from(points);
    let rng = stream_for_linfa(seed, "labels/k-means", rerun);
    let model = KMeans::params_with_rng(clusters, rng)
        .init_method(KMeansInit::KMeansPlusPlus)
        .n_runs(RESTARTS)
        .tolerance(TOLERANCE)
        .max_n_iterations(MAX_ITERATIONS)
        .fit(&points)
        .map_err(|error| Error::input("k-means", error, "clusters"))?;
    let mut of = vec![None; surfaces];
    for (&at, &class) in rows.iter().zip(&model.predict(points.records())) {
        of[at] = Some(class as u32);
    }
    Ok(Labels {
        classes: clusters,
        of,
    })
}

fn distinct(points: &Array2<f64>) -> usize {
    // Adding zero makes the two zeros one.
    let bits = |row: ArrayView1<'_, f64>| row.iter().map(|v| (v + 0.0).to_bits()).collect();
    let rows: HashSet<Vec<u64>> = points.rows().into_iter().map(bits).collect();
    rows.len()
}

/// The stream of [`streams::named_stream`], for linfa, which takes rand 0.8.
pub(super) fn stream_for_linfa(seed: u64, purpose: &str, index: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::from_seed(streams::key(seed, streams::name(purpose)));
    rng.set_stream(index);
    rng
}
