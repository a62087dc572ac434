use sps_regress::nearest::{Nearest, TrainedNearests, squared_distance};
use sps_regress::{
    Embeddings, FittedRegressor, Plan, Readings, Rerun, Result, TrainingData, Views,
};

/// Five surfaces on a line, of two views each, and the readings of two properties.
fn fitted(properties: [[Option<f64>; 5]; 2]) -> Result<TrainedNearests> {
    let places = [0.0_f32, 1.0, 1.0, 4.0, 9.0];
    let values = places.iter().flat_map(|&x| [x, 0.5, 2.0 * x, 0.5]);
    let embeddings = Embeddings::new(values.collect(), [5, 2, 2])?;
    let rows: Vec<Vec<_>> = (0..5).map(|s| properties.map(|p| p[s]).to_vec()).collect();
    let readings = Readings::new(vec!["a".into(), "b".into()], &rows)?;
    let data = TrainingData::new(&embeddings, &readings);
    let rerun = Rerun::new(4, vec![4, 2, 1, 0]);
    let plan = Plan::each(1, readings.properties(), vec![rerun]);
    Nearest.train(&data, &plan.with_views(&Views::Fixed(vec![1, 0])))
}

fn predict(nearests: &dyn FittedRegressor, places: &[f32]) -> Vec<Vec<f64>> {
    let values = places.iter().flat_map(|&x| [2.0 * x, 0.5, x, 0.5]);
    let embeddings = Embeddings::new(values.collect(), [places.len(), 2, 2]).unwrap();
    let estimates = nearests.predict(&embeddings).unwrap();
    estimates.into_iter().map(|e| e.values).collect()
}

#[test]
fn the_nearest_surface_with_a_reading_answers() {
    let a = [10.0, 11.0, 12.0, 13.0, 14.0].map(Some);
    let b = [Some(20.0), None, Some(22.0), Some(23.0), None];
    let nearests = fitted([a, b]).unwrap();
    // Surface 3 is no training surface; 1 and 2 are equal; 5 is half way from 1 to 9.
    let found = predict(&nearests, &[-3.0, 0.4, 0.6, 4.0, 5.0, 5.1, 90.0]);
    assert_eq!(found[0], [10.0, 10.0, 11.0, 11.0, 11.0, 14.0, 14.0]);
    assert_eq!(found[1], [20.0, 20.0, 22.0, 22.0, 22.0, 22.0, 22.0]);
    assert_eq!(nearests.multiply_adds(), 4 * 4 + 2 * 4);
    let second = nearests.filtered(&|trial| trial.property == "b");
    assert_eq!(second.trials()[0].rerun, 4);
    assert_eq!(predict(second.as_ref(), &[0.6, 90.0]), [[22.0, 22.0]]);
}

#[test]
fn distances_are_sums_of_squares() {
    let a: Vec<f32> = (0..35).map(|i| i as f32).collect();
    let b = vec![1.0_f32; 35];
    // The squares of 1, 0, 1, .. 33.
    assert_eq!(squared_distance(&a, &b), 1.0 + (33 * 34 * 67 / 6) as f32);
}

#[test]
fn hard_cases() {
    let error = fitted([[Some(1.0); 5], [None, None, None, Some(1.0), None]]).unwrap_err();
    assert!(error.to_string().contains('b'), "{error}");
    let nearests = fitted([[Some(1.0); 5]; 2]).unwrap();
    let embeddings = Embeddings::new(vec![0.0; 6], [3, 1, 2]).unwrap();
    let error = nearests.predict(&embeddings).unwrap_err();
    assert!(error.to_string().contains("1 views of width 2"), "{error}");
}
