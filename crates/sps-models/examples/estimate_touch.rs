//! Embeddings and readings to a fitted cross-modal network, and from it to estimates of surfaces
//! that it has not seen; beside them ridge regression's.
//!
//! `cargo run --release -p sps-models --example estimate_touch`

use sps_models::candle::{Device, Tensor};
use sps_models::heads::{Head, HeadConfig, Plan, Rerun, TrainingData};
use sps_models::optim::AdamConfig;
use sps_models::ridge::{Ridge, RidgeConfig};
use sps_models::{Embeddings, Readings, Regressor};

const SURFACES: usize = 120;
const TRAINING: usize = 90;
const WIDTH: usize = 16;

/// Feature `at` of a surface's embedding; an encoder's in earnest.
fn feature(surface: usize, at: usize) -> f32 {
    ((surface * (at + 3)) as f32 * 0.618).sin()
}

/// What was felt on it, in measured units: not quite what the first features say.
fn reading(surface: usize) -> f64 {
    let [first, second] = [0, 1].map(|at| f64::from(feature(surface, at)));
    40.0 + 12.0 * first + 8.0 * first * second
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let features = (0..SURFACES).flat_map(|s| (0..WIDTH).map(move |at| feature(s, at)));
    let shape = (SURFACES, WIDTH);
    let embeddings = Tensor::from_iter(features, &Device::Cpu)?.reshape(shape)?;
    let embeddings = Embeddings::new(&embeddings)?;
    // A reading that was not taken is `None`; the first surface has none.
    let rows: Vec<_> = (0..SURFACES)
        .map(|surface| vec![(surface > 0).then(|| reading(surface))])
        .collect();
    let readings = Readings::new(vec!["friction".into()], &rows)?;
    let data = TrainingData::new(&embeddings, &readings);
    let rerun = Rerun {
        number: 0,
        training: (0..TRAINING).collect(),
        validation: Vec::new(),
    };
    let plan = Plan::each(1, readings.properties(), vec![rerun]);

    let head = Head::new(HeadConfig {
        epochs: 120,
        adam: AdamConfig {
            learning_rate: 2e-3,
            ..AdamConfig::default()
        },
        ..HeadConfig::default()
    })?;
    let ridge = Ridge::new(RidgeConfig::default())?;
    let unseen: Vec<usize> = (TRAINING..SURFACES).collect();
    let regressors: [(&str, &dyn Regressor); 2] = [("cross-modal", &head), ("ridge", &ridge)];
    for (name, regressor) in regressors {
        let fitted = regressor.fit(&data, &plan)?;
        let estimates = fitted.predict(&embeddings.select(&unseen, &[0])?)?;
        let errors = unseen.iter().zip(&estimates[0].values);
        let errors = errors.map(|(&surface, estimate)| (estimate - reading(surface)).abs());
        let mean = errors.sum::<f64>() / unseen.len() as f64;
        println!(
            "{name}: {} off by {mean:.2} on average",
            estimates[0].property
        );
    }
    Ok(())
}
