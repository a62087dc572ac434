//! Against scikit-learn and SciPy.
#![allow(clippy::unreadable_literal, reason = "as the scripts printed them")]

use ndarray::{Array2, ArrayView2};
use safetensors::SafeTensors;
use sps_metrics::{Samples, Table, TableParts, TrainingMean};

use crate::support::{assert_close, uniform, value};

const SURFACES: usize = 41;
const PROPERTIES: usize = 15;
/// Both sides are f64; what is left is the rounding of NumPy's sums over 41 values.
const BOUND: f64 = 1e-13;

struct Fixture {
    truth: Array2<f64>,
    estimate: Array2<f64>,
    means: Vec<f64>,
}

fn fixture() -> Fixture {
    let shape = (SURFACES, PROPERTIES);
    let count = SURFACES * PROPERTIES;
    let truth: Vec<f64> = uniform("golden/metrics.truth")
        .map(|u| (u + 1.0) * 50.0)
        .take(count)
        .collect();
    let errors = uniform("golden/metrics.error").map(|u| 12.0 * u);
    let estimate = truth.iter().zip(errors).map(|(t, e)| t + e).collect();
    Fixture {
        truth: Array2::from_shape_vec(shape, truth).expect("the count is the product"),
        estimate: Array2::from_shape_vec(shape, estimate).expect("the count is the product"),
        means: uniform("golden/metrics.train_mean")
            .map(|u| (u + 1.0) * 50.0)
            .take(PROPERTIES)
            .collect(),
    }
}

fn read(name: &str) -> Vec<f64> {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../fixtures/golden/metrics.safetensors"
    );
    let bytes = std::fs::read(path).expect("the golden file");
    let tensors = SafeTensors::deserialize(&bytes).expect("a safetensors file");
    let tensor = tensors.tensor(name).expect("a tensor of that name");
    assert_eq!(tensor.dtype(), safetensors::Dtype::F64);
    let numbers = tensor.data().chunks_exact(8);
    numbers
        .map(|bytes| f64::from_le_bytes(bytes.try_into().expect("eight bytes")))
        .collect()
}

fn view(array: &Array2<f64>) -> ArrayView2<'_, f64> {
    array.view()
}

#[test]
fn scores_match_scikit_learn() {
    let fixture = fixture();
    let table = Table::new(TableParts {
        truth: view(&fixture.truth),
        estimate: view(&fixture.estimate),
        measured: None,
    })
    .expect("equal shapes");
    let means: Vec<_> = fixture
        .means
        .iter()
        .copied()
        .map(TrainingMean::new)
        .collect();
    let scores = table.scores(&means).expect("a mean per property");
    assert_eq!(scores.len(), PROPERTIES);
    for (property, scores) in scores.iter().enumerate() {
        let found = [
            ("r2_train_mean", &scores.r2),
            ("r2_own_mean", &scores.r2_own_mean),
            ("mae", &scores.mae),
            ("median_percent_error", &scores.median_percent_error),
        ];
        for (name, outcome) in found {
            assert_close(value(outcome), read(name)[property], BOUND);
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
    let fixture = fixture();
    for property in 0..PROPERTIES {
        let truth = fixture.truth.column(property).to_vec();
        let estimate = fixture.estimate.column(property).to_vec();
        let samples = Samples {
            truth: &truth,
            estimate: &estimate,
        };
        assert_close(value(&samples.rmse()), RMSE[property], BOUND);
        assert_close(value(&samples.spearman()), SPEARMAN[property], BOUND);

        let tied = Samples {
            truth: &truth.iter().map(|t| (t / 20.0).round()).collect::<Vec<_>>(),
            estimate: &estimate
                .iter()
                .map(|p| (p / 25.0).round())
                .collect::<Vec<_>>(),
        };
        assert_close(value(&tied.spearman()), SPEARMAN_TIED[property], BOUND);
    }
}
