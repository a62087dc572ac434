//! Embeddings and readings to fitted regressors, and from them to estimates of surfaces that they have not seen.
//!
//! `cargo run --release -p sps-regress --example estimate_touch`

use sps_regress::kernel_ridge::KernelRidge;
use sps_regress::nearest::Nearest;
use sps_regress::ridge::Ridge;
use sps_regress::stacking::Stacking;
use sps_regress::{Embeddings, Plan, Readings, Regressor, Rerun, TrainingData};

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

fn main() -> sps_regress::Result<()> {
    let features = (0..SURFACES).flat_map(|s| (0..WIDTH).map(move |at| feature(s, at)));
    let embeddings = Embeddings::new(features.collect(), [SURFACES, 1, WIDTH])?;
    // A reading that was not taken is `None`; the first surface has none.
    let row = |surface| vec![(surface > 0).then(|| reading(surface))];
    let rows: Vec<_> = (0..SURFACES).map(row).collect();
    let readings = Readings::new(vec!["friction".into()], &rows)?;
    let data = TrainingData::new(&embeddings, &readings);
    let rerun = Rerun::new(0, 0..TRAINING);
    let plan = Plan::each(1, readings.properties(), vec![rerun]);

    let (ridge, kernel_ridge) = (Ridge::default(), KernelRidge::default());
    let members: Vec<Box<dyn Regressor>> =
        vec![Box::new(ridge.clone()), Box::new(kernel_ridge.clone())];
    let regressors: [(&str, Box<dyn Regressor>); 4] = [
        ("ridge", Box::new(ridge)),
        ("kernel ridge", Box::new(kernel_ridge)),
        ("nearest neighbour", Box::new(Nearest)),
        ("both ridges stacked", Box::new(Stacking::new(members, 5)?)),
    ];
    let unseen: Vec<usize> = (TRAINING..SURFACES).collect();
    for (name, regressor) in regressors {
        let fitted = regressor.fit(&data, &plan)?;
        let estimates = fitted.predict(&embeddings.select(&unseen, &[0])?)?;
        let errors = unseen.iter().zip(&estimates[0].values);
        let errors = errors.map(|(&surface, estimate)| (estimate - reading(surface)).abs());
        let mean = errors.sum::<f64>() / unseen.len() as f64;
        let property = &estimates[0].property;
        println!("{name}: {property} off by {mean:.2} on average");
    }
    Ok(())
}
