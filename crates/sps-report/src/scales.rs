//! What is known of each property over all that a method estimated.

use std::collections::BTreeMap;

use sps_experiment::predictions::Prediction;

use crate::figures::span;

/// Of one property.
pub(super) struct Scale {
    /// The lowest and the highest of measured and estimated values.
    pub ends: [f64; 2],
    /// The standard deviation of the measured ones; above 0.
    pub deviation: f64,
}

/// By property; those are left out that measure alike on all surfaces.
pub(super) type Scales<'a> = BTreeMap<&'a str, Scale>;

/// Over the predictions of one method.
pub(super) fn scales<'a>(predictions: &[&'a Prediction]) -> Scales<'a> {
    let mut of_property: BTreeMap<&str, Vec<&Prediction>> = BTreeMap::new();
    for prediction in predictions {
        let of = of_property.entry(&prediction.property).or_default();
        of.push(prediction);
    }
    let scales = of_property.into_iter();
    scales
        .map(|(property, predictions)| (property, Scale::of(&predictions)))
        .filter(|(_, scale)| scale.deviation > 0.0)
        .collect()
}

impl Scale {
    fn of(predictions: &[&Prediction]) -> Self {
        let count = predictions.len() as f64;
        let mean = predictions.iter().map(|p| p.truth).sum::<f64>() / count;
        let squares = predictions.iter().map(|p| (p.truth - mean).powi(2));
        let values = predictions.iter().flat_map(|p| [p.truth, p.estimate]);
        Self {
            ends: span(values),
            deviation: (squares.sum::<f64>() / count).sqrt(),
        }
    }

    pub(super) fn error(&self, prediction: &Prediction) -> f64 {
        (prediction.estimate - prediction.truth).abs() / self.deviation
    }
}
