//! Against scikit-learn and SciPy.
#![allow(clippy::unreadable_literal, reason = "as the scripts printed them")]

use safetensors::SafeTensors;
use sps_metrics::{Samples, Scores, TrainingMean};

use crate::support::rule::uniform;
use crate::support::{assert_close, value};

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
fn scores_match_scikit_learn() {
    let names = [
        "r2_train_mean",
        "r2_own_mean",
        "mae",
        "median_percent_error",
    ];
    let expected = names.map(read);
    for (property, (truth, estimate, mean)) in fixture().iter().enumerate() {
        let samples = Samples { truth, estimate };
        let scores = Scores::of(samples, TrainingMean::new(*mean));
        let Scores {
            r2,
            r2_own_mean,
            mae,
            median_percent_error,
            ..
        } = &scores;
        let found = [r2, r2_own_mean, mae, median_percent_error];
        for (outcome, expected) in found.into_iter().zip(&expected) {
            assert_close(value(outcome), expected[property], BOUND);
        }
    }
}

/// `sklearn.metrics.root_mean_squared_error(t, p, multioutput="raw_values")`, 1.9.1, on the same
/// table.
const RMSE: [f64; PROPERTIES] = [
    5.795143160954522,
    7.1024784863588115,
    6.382603462936868,
    6.2505274196709575,
    6.616552595577024,
    6.93911314799282,
    7.230377469054878,
    6.9316125722897866,
    6.988671012348617,
    6.192117459116499,
    6.132471116234473,
    7.305707015454971,
    6.717422157159412,
    7.237386160468907,
    7.6852723980979905,
];

/// `scipy.stats.spearmanr(t[:, i], p[:, i]).statistic`, 1.17.1, on the same table.
const SPEARMAN: [f64; PROPERTIES] = [
    0.9770034843205577,
    0.9790940766550524,
    0.9665505226480839,
    0.9801393728222999,
    0.9477351916376308,
    0.953658536585366,
    0.9581881533101048,
    0.9745644599303137,
    0.961672473867596,
    0.9790940766550524,
    0.9754355400696865,
    0.9644599303135891,
    0.9722996515679445,
    0.9653310104529619,
    0.9651567944250872,
];

/// The same of `numpy.round(t / 20)` and `numpy.round(p / 25)`, where most values are tied.
const SPEARMAN_TIED: [f64; PROPERTIES] = [
    0.9384874905415331,
    0.9392354177951556,
    0.9161413297071236,
    0.9395618660038297,
    0.9271586866706378,
    0.9483459772529568,
    0.9423115503777993,
    0.9335809601854133,
    0.9546951640073184,
    0.9455583123890452,
    0.9516481963047928,
    0.9226690041001246,
    0.9402327222592812,
    0.9394712779603217,
    0.9252420738088043,
];

#[test]
fn rmse_and_spearman_match_scikit_learn_and_scipy() {
    for (property, (truth, estimate, _)) in fixture().iter().enumerate() {
        let samples = Samples { truth, estimate };
        assert_close(value(&samples.rmse()), RMSE[property], BOUND);
        assert_close(value(&samples.spearman()), SPEARMAN[property], BOUND);

        let rounded = |values: &[f64], step: f64| -> Vec<f64> {
            values.iter().map(|v| (v / step).round()).collect()
        };
        let (truth, estimate) = (rounded(truth, 20.0), rounded(estimate, 25.0));
        let tied = Samples {
            truth: &truth,
            estimate: &estimate,
        };
        assert_close(value(&tied.spearman()), SPEARMAN_TIED[property], BOUND);
    }
}
