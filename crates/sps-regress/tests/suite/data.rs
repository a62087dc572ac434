use sps_regress::nearest::Nearest;
use sps_regress::ridge::Ridge;
use sps_regress::{Embeddings, FittedRegressor, Plan, Readings, Rerun, TrainingData, Views};

use crate::golden::uniform;

/// Two views of two blocks, 2 and 3 wide, each of which is measured in units of its own.
fn embeddings(units: [f32; 4]) -> Embeddings {
    let values = uniform("blocks", 30 * 10).into_iter().enumerate();
    let unit = |at: usize| match at % 10 {
        0..2 => units[0],
        2..5 => units[1],
        5..7 => units[2],
        _ => units[3],
    };
    let values = values.map(|(at, value)| value as f32 * unit(at));
    let embeddings = Embeddings::new(values.collect(), [30, 2, 5]).unwrap();
    embeddings.in_blocks(&[2, 3]).unwrap()
}

#[test]
fn every_block_of_every_view_is_brought_to_a_mean_variance_of_1() {
    let found = embeddings([1.0, 100.0, 0.01, 0.0]).balanced();
    for (place, expected) in [(0..2, 1.0), (2..5, 1.0), (5..7, 1.0), (7..10, 0.0)] {
        let variance = |feature: usize| {
            let values = (0..30).map(|s| f64::from(found.values()[10 * s + feature]));
            let values: Vec<f64> = values.collect();
            let mean = values.iter().sum::<f64>() / 30.0;
            values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 30.0
        };
        let count = place.len() as f64;
        let mean = place.clone().map(variance).sum::<f64>() / count;
        assert!((mean - expected).abs() < 1e-5, "{place:?}: {mean}");
    }
    let one = embeddings([1.0, 100.0, 0.01, 1.0]).in_blocks(&[5]);
    let one = one.unwrap();
    assert_eq!(one.balanced(), one);
}

/// Powers of two change no bit, so that estimates must be the same to the last.
#[test]
fn units_of_blocks_do_not_matter() {
    let rows = uniform("touch", 30).into_iter().map(|v| vec![Some(v)]);
    let readings = Readings::new(vec!["p".into()], &rows.collect::<Vec<_>>()).unwrap();
    let rerun = Rerun::new(0, 0..20);
    let mut plan = Plan::each(1, readings.properties(), vec![rerun]);
    plan.trials[0].views = Views::Fixed(vec![0, 1]);
    let estimates = |units| {
        let embeddings = embeddings(units);
        let data = TrainingData::new(&embeddings, &readings);
        let ridge = Ridge::default();
        let ridge = ridge.train(&data, &plan).unwrap();
        let nearest = Nearest.train(&data, &plan).unwrap();
        [
            ridge.predict(&embeddings).unwrap()[0].values.clone(),
            nearest.predict(&embeddings).unwrap()[0].values.clone(),
        ]
    };
    assert_eq!(estimates([1.0; 4]), estimates([8.0, 0.25, 8.0, 0.25]));
}

#[test]
fn embeddings_and_readings_are_checked() {
    for (values, shape) in [
        (vec![], [1, 1, 0]),
        (vec![], [1, 0, 3]),
        (vec![1.0], [1, 1, 2]),
        (vec![1.0], [usize::MAX, usize::MAX, 1]),
    ] {
        assert!(Embeddings::new(values, shape).is_err(), "{shape:?}");
    }
    let error = Embeddings::new(vec![1.0, 2.0, f32::NAN, 4.0], [2, 1, 2]).unwrap_err();
    assert!(error.to_string().contains("NaN in surface 1"), "{error}");
    let two = Embeddings::new(vec![1.0, 2.0], [2, 1, 1]).unwrap();
    assert!(two.select(&[2], &[0]).is_err());
    assert!(two.select(&[0], &[1]).is_err());
    assert!(two.select(&[0], &[]).is_err());
    assert_eq!(two.get(2, 0), None);

    let names = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<_>>();
    assert!(Readings::new(Vec::new(), &[]).is_err());
    assert!(Readings::new(names(&["a", "a"]), &[]).is_err());
    assert!(Readings::new(names(&["a"]), &[vec![]]).is_err());
    let message = Readings::new(names(&["a"]), &[vec![Some(f64::INFINITY)]]).unwrap_err();
    let message = message.to_string();
    assert!(message.contains("inf for a of surface 0"), "{message}");
    let readings = Readings::new(names(&["a", "b"]), &[vec![None, Some(2.0)]]).unwrap();
    assert_eq!((readings.get(0, 1), readings.get(0, 0)), (Some(2.0), None));
    let outside = (readings.get(0, 2), readings.get(usize::MAX, 0));
    assert_eq!(outside, (None, None));
}
