//! Against scikit-learn and SciPy.

use safetensors::SafeTensors;
use sps_metrics::{Scores, TrainingMean};

use crate::support::rule::uniform;
use crate::support::{assert_close, samples, value};

const SURFACES: usize = 41;
const PROPERTIES: usize = 15;
/// Both sides are f64; what is left is the rounding of NumPy's sums over 41 values.
const BOUND: f64 = 1e-13;

/// Truths, estimates and the mean of a training split, by property.
fn fixture() -> Vec<(Vec<f64>, Vec<f64>, f64)> {
    let rows = |name| uniform(name, SURFACES * PROPERTIES);
    let (truth, error) = (rows("golden/metrics.truth"), rows("golden/metrics.error"));
    let truth: Vec<f64> = truth.iter().map(|u| (u + 1.0) * 50.0).collect();
    let estimate: Vec<f64> = truth.iter().zip(error).map(|(t, u)| t + 12.0 * u).collect();
    let means = uniform("golden/metrics.train_mean", PROPERTIES).into_iter();
    let of = |values: &[f64], property: usize| {
        let column = values[property..].iter().step_by(PROPERTIES);
        column.copied().collect()
    };
    let row = |(property, u): (usize, f64)| {
        let mean = (u + 1.0) * 50.0;
        (of(&truth, property), of(&estimate, property), mean)
    };
    means.enumerate().map(row).collect()
}

fn read(name: &str) -> Vec<f64> {
    let folder = env!("CARGO_MANIFEST_DIR");
    let bytes = std::fs::read(format!(
        "{folder}/../../fixtures/golden/metrics.safetensors"
    ));
    let bytes = bytes.expect("the golden file");
    let tensors = SafeTensors::deserialize(&bytes).expect("a safetensors file");
    let tensor = tensors.tensor(name).expect("a tensor of that name");
    assert_eq!(tensor.dtype(), safetensors::Dtype::F64);
    let (numbers, _) = tensor.data().as_chunks::<8>();
    numbers.iter().map(|b| f64::from_le_bytes(*b)).collect()
}

#[test]
fn scores_match_scikit_learn_and_scipy() {
    let names = [
        "r2_train_mean",
        "r2_own_mean",
        "mae",
        "rmse",
        "median_percent_error",
        "spearman",
        "spearman_tied",
    ];
    let expected = names.map(read);
    for (property, (truth, estimate, mean)) in fixture().iter().enumerate() {
        let Scores {
            r2,
            r2_own_mean,
            mae,
            rmse,
            median_percent_error,
            spearman,
        } = Scores::of(samples(truth, estimate), TrainingMean::new(*mean));
        // Most values are tied.
        let truth: Vec<f64> = truth.iter().map(|t| (t / 20.0).round()).collect();
        let estimate: Vec<f64> = estimate.iter().map(|p| (p / 25.0).round()).collect();
        let tied = samples(&truth, &estimate).spearman();
        let found = [r2, r2_own_mean, mae, rmse, median_percent_error, spearman];
        let found = found.into_iter().chain([tied]);
        for (outcome, expected) in found.zip(&expected) {
            assert_close(value(&outcome), expected[property], BOUND);
        }
    }
}
