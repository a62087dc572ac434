use ndarray::{Array2, Axis, concatenate};
use sps_regress::ridge::{Ridge, RidgeConfig, TrainedRidges};
use sps_regress::{Embeddings, FittedRegressor, TrainingData};

use crate::support::{Set, solved};

fn embeddings(surfaces: usize, width: usize) -> Embeddings {
    let value = |i: usize| ((i * i * 7 + i * 13) % 101) as f32 / 50.0 - 1.0;
    let values: Vec<f32> = (0..surfaces * width).map(value).collect();
    Embeddings::new(values, [surfaces, 1, width]).unwrap()
}

fn values(surfaces: usize) -> Vec<f64> {
    let value = |i: usize| 20.0 + ((i * 31) % 17) as f64;
    (0..surfaces).map(value).collect()
}

/// The weights and the intercept, which is the weight of a feature without penalty, by the normal equations.
fn direct(rows: &Array2<f64>, values: &[f64], penalty: f64) -> (Vec<f64>, f64) {
    let (samples, width) = rows.dim();
    let features = concatenate![Axis(1), *rows, Array2::ones((samples, 1))];
    let values = Array2::from_shape_fn((samples, 1), |(row, _)| values[row]);
    let mut system = features.t().dot(&concatenate![Axis(1), features, values]);
    for feature in 0..width {
        system[[feature, feature]] += samples as f64 * penalty;
    }
    let mut weights = solved(system);
    let intercept = weights.pop().unwrap();
    (weights, intercept)
}

/// On all surfaces, each of them or each unit left out to choose a penalty.
fn fit(
    features: &Embeddings,
    values: &[f64],
    units: Option<&[usize]>,
    penalties: &[f64],
) -> TrainedRidges {
    let readings = values.iter().copied().map(Some).collect();
    let set = Set::of(features.clone(), &[readings]);
    let plan = set.plan(0..values.len(), &[0]);
    let data = set.data();
    let penalties = penalties.to_vec();
    let ridge = Ridge::new(RidgeConfig { penalties }).unwrap();
    ridge.train(&TrainingData { units, ..data }, &plan).unwrap()
}

fn mean_variance(rows: &Array2<f64>) -> f64 {
    rows.var_axis(Axis(0), 1.0).mean().unwrap()
}

#[test]
fn the_fit_solves_the_normal_equations() {
    for (surfaces, width) in [(40, 6), (12, 30)] {
        let features = embeddings(surfaces, width);
        let values = values(surfaces);
        let bytes = fit(&features, &values, None, &[0.3]).to_bytes().unwrap();
        let file: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        let fit = &file["ridges"][0];
        let rows = features.table();
        let (weights, intercept) = direct(&rows, &values, 0.3 * mean_variance(&rows));
        let found = fit["weights"].as_array().unwrap();
        assert_eq!(found.len(), width);
        for (found, expected) in found.iter().zip(&weights) {
            let found = found.as_f64().unwrap();
            assert!((found - expected).abs() < 1e-8, "{found} {expected}");
        }
        assert!((fit["intercept"].as_f64().unwrap() - intercept).abs() < 1e-8);
    }
}

/// Surfaces one by one, and in units of 1 to 7 of them. What each of the first penalties costs is told from what a
/// penalty beyond the best costs, be it a billionth more or less.
#[test]
fn the_penalty_is_the_best_when_each_unit_is_left_out() {
    let features = embeddings(25, 10);
    let rows = features.table();
    let noise = values(25).into_iter().zip(rows.rows());
    let values: Vec<f64> = noise
        .map(|(v, row)| v + 12.0 * row[0] - 9.0 * row[3])
        .collect();
    let scale = mean_variance(&rows);
    let all: Vec<usize> = (0..25).collect();
    let uneven = |i: usize| (f64::from(i as u32) * 2.0 + 0.25).sqrt() as usize;
    for units in [all.clone(), all.iter().map(|&i| uneven(i)).collect()] {
        let error = |penalty: f64| -> f64 {
            let left_out = |out: usize| {
                let others = all.iter().copied().filter(|&i| units[i] != units[out]);
                let others: Vec<usize> = others.collect();
                let kept: Vec<f64> = others.iter().map(|&i| values[i]).collect();
                // n times the penalty stays what it is with all surfaces.
                let penalty = penalty * scale * 25.0 / others.len() as f64;
                let (weights, intercept) = direct(&rows.select(Axis(0), &others), &kept, penalty);
                let row = rows.row(out);
                let estimate: f64 = row.iter().zip(&weights).map(|(x, w)| x * w).sum();
                (values[out] - intercept - estimate).powi(2)
            };
            all.iter().map(|&out| left_out(out)).sum::<f64>() / 25.0
        };
        let chosen = |penalties: &[f64]| {
            let trained = fit(&features, &values, Some(&units), penalties);
            trained.models()[0].penalty()
        };
        let penalties = [0.01, 0.1, 1.0, 10.0];
        let less = |a: &f64, b: &f64| error(*a).total_cmp(&error(*b));
        assert_eq!(penalties.into_iter().min_by(less), Some(chosen(&penalties)));
        for small in [0.001, 0.01, 0.1] {
            let [better, worse] = [-1e-9, 1e-9].map(|part| {
                let [mut low, mut high] = [0.3, 1000.0];
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if error(middle) < error(small) * (1.0 + part) {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                high
            });
            assert_eq!(chosen(&[small, better]), better);
            assert_eq!(chosen(&[small, worse]), small);
        }
    }
}

#[test]
fn equal_surfaces_get_the_mean() {
    let features = Embeddings::new(vec![1.0; 15], [5, 1, 3]).unwrap();
    let fit = fit(&features, &[1.0, 2.0, 3.0, 4.0, 5.0], None, &[0.1]);
    assert_eq!(fit.predict(&features).unwrap()[0].values, [3.0; 5]);
}
