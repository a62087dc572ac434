//! What a selector reports.

use serde::{Deserialize, Serialize};

/// The picks of a selector, and what they cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Selection {
    /// The M picked views, in the order of the slots.
    pub picks: Vec<usize>,
    /// The loss of the picks.
    pub loss: f64,
    /// The search as it went: one point for each round of evaluations.
    pub curve: Vec<CurvePoint>,
    /// Sets whose loss the selector asked for, repeats included, the picks' own included.
    pub evaluations: u64,
    /// Those of them that the loss was computed for: the rest was remembered.
    pub computed: u64,
    /// Wall time of the selection, in seconds.
    pub seconds: f64,
}

impl Selection {
    /// How far the picks are from the optimum, as a share of the distance from a random set to the
    /// optimum: 0 is the optimum, 1 is no better than random. `random` is the mean loss of random
    /// sets, `optimum` the lowest loss of all (see [`Exhaustive`](crate::Exhaustive)).
    ///
    /// `None` where random sets are no worse than the optimum, so that there is no distance.
    pub fn regret(&self, random: f64, optimum: f64) -> Option<f64> {
        let distance = random - optimum;
        (distance > 0.0).then(|| (self.loss - optimum) / distance)
    }
}

/// One round of a search.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct CurvePoint {
    /// Sets asked for up to the end of the round, repeats included.
    pub evaluations: u64,
    /// Mean loss of the round's sets.
    pub mean: f64,
    /// Lowest loss of all sets up to the end of the round.
    pub best: f64,
}
