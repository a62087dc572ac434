//! Two models of three properties on the same test surfaces: their scores, means over properties,
//! and whether the difference is more than chance.
//!
//! `cargo run --release -p sps-metrics --example compare_models`

use sps_metrics::{
    Intervals, Level, Metric, PropertyScore, Samples, Scored, TrainingMean, mean_over_all,
};

const PROPERTIES: [&str; 3] = ["friction", "hardness", "warmth"];

/// Surfaces that both models are tested on.
const SURFACES: usize = 60;

/// What was measured on a surface.
fn truth(property: usize, surface: usize) -> f64 {
    50.0 + 20.0 * (surface as f64 * (1.3 + property as f64)).sin()
}

/// What a model says whose errors are as wide as `share` of the truths.
fn estimate(property: usize, surface: usize, share: f64) -> f64 {
    truth(property, surface) + 20.0 * share * (surface as f64 * 7.7 + property as f64).cos()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let of = |value: &dyn Fn(usize) -> f64| (0..SURFACES).map(value).collect::<Vec<f64>>();
    let intervals = Intervals::of_models(Level::P95);
    let mut scores = [Vec::new(), Vec::new()];
    for (property, name) in PROPERTIES.into_iter().enumerate() {
        let truth = of(&|surface| truth(property, surface));
        let models = [0.4, 0.6].map(|share| of(&|surface| estimate(property, surface, share)));
        // Of other surfaces, in earnest.
        let mean = TrainingMean::new(50.0)?;
        for (estimate, scores) in models.iter().zip(&mut scores) {
            let samples = Samples {
                truth: &truth,
                estimate,
            };
            scores.push(PropertyScore::new(name, samples.r2(mean)));
            let r2 = intervals.interval(&[Scored {
                metric: Metric::R2(mean),
                samples,
                units: None,
                rerun: 0,
            }])?;
            let [value, low, high] = [r2.estimate, r2.low, r2.high];
            println!("{name}: R² {value:.2} [{low:.2}, {high:.2}]");
        }
        let [first, second] = [&models[0], &models[1]].map(|estimate| {
            [Scored {
                metric: Metric::Mae,
                samples: Samples {
                    truth: &truth,
                    estimate,
                },
                units: None,
                rerun: 0,
            }]
        });
        let gain = intervals.difference(&second, &first)?;
        let [value, low, high] = [gain.estimate, gain.low, gain.high];
        println!("{name}: the first errs by {value:.2} [{low:.2}, {high:.2}] less");
    }
    for (model, scores) in ["first", "second"].into_iter().zip(&scores) {
        let mean = mean_over_all(scores);
        println!("{model} model: mean R² {:.2}", mean.value?);
    }
    Ok(())
}
