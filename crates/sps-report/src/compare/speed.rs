//! Speed beside error.

use serde::Serialize;
use sps_experiment::results::{MethodResult, Number};

/// What the estimate of one surface costs in each run, and what it is worth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Speeds {
    pub method: String,
    /// The share of variance left unexplained, 1 - R², on average over properties.
    pub error: [Number; 2],
    pub frames_encoded_per_surface: [f64; 2],
    pub predict_seconds_per_surface: [Number; 2],
    /// The seconds of the second run as a multiple of the first's.
    pub times: Number,
}

impl Speeds {
    pub(super) fn of(methods: [&MethodResult; 2]) -> Self {
        let seconds = methods.map(|method| method.costs.predict_seconds_per_surface);
        let times = seconds[0].zip(seconds[1]);
        let times = times.filter(|(first, _)| *first > 0.0);
        Self {
            method: methods[0].id.clone(),
            error: methods.map(|method| method.means.r2_mean.map(|r2| 1.0 - r2)),
            frames_encoded_per_surface: methods.map(|m| m.costs.frames_encoded_per_surface),
            predict_seconds_per_surface: seconds,
            times: times.map(|(first, second)| second / first),
        }
    }
}
