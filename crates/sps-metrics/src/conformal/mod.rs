//! Intervals that cover at a promised rate, and whether they did.

mod coverage;
mod group;
mod split;

use thiserror::Error;

use crate::level::{Level, steps};
use crate::outcome::{Quantity, Undefined};
use crate::screen::Screen;

pub use coverage::{Coverage, coverage};
pub use group::GroupConformal;
pub use split::SplitConformal;

/// The range in which a truth is expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictionInterval {
    /// The lower end, which belongs to the interval.
    pub low: f64,
    /// The upper end, which belongs to the interval.
    pub high: f64,
}

/// Why there is no interval that keeps its promise.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ConformalError {
    /// With so few samples only an infinite interval covers at this level.
    #[error("{found} calibration sample(s), a level of {} needs at least {needed}", level.get())]
    TooFewSamples {
        /// How many there are.
        found: usize,
        /// How many the level needs: the least n with ceil((n + 1) level) <= n.
        needed: usize,
        /// The level asked for.
        level: Level,
    },
    /// The residuals are undefined.
    #[error("the residuals are undefined: {0}")]
    Undefined(#[from] Undefined),
    /// With so few groups only an infinite interval covers a new one at this level: K groups reach
    /// K / (K + 1), seven 7/8.
    #[error(
        "{found} calibration group(s) allow a level of {found}/{}, a level of {} needs at least {needed}",
        found + 1,
        level.get()
    )]
    TooFewGroups {
        /// How many there are, K.
        found: usize,
        /// How many the level needs: the least K with (K + 1) level <= K.
        needed: usize,
        /// The level asked for.
        level: Level,
    },
    /// Samples and group numbers do not pair up.
    #[error("{groups} group numbers for {samples} samples")]
    GroupMismatch {
        /// How many samples there are.
        samples: usize,
        /// How many group numbers there are.
        groups: usize,
    },
}

impl PredictionInterval {
    /// The interval that reaches `radius` to either side of an estimate.
    pub fn around(estimate: f64, radius: f64) -> Self {
        Self {
            low: estimate - radius,
            high: estimate + radius,
        }
    }
}

/// The absolute residuals, at least one and all finite.
fn sizes(residuals: &[f64]) -> Result<Vec<f64>, Undefined> {
    let mut screen = Screen::default();
    for &residual in residuals {
        screen.admit([(Quantity::Residual, residual)]);
    }
    screen.samples()?;
    Ok(residuals.iter().map(|residual| residual.abs()).collect())
}

/// Which of n + 1 exchangeable ones in order, the new one among them, the level reaches.
fn rank(calibration: usize, level: Level) -> usize {
    (steps(calibration + 1, level.get()).ceil() as usize).max(1)
}

/// The least n with ceil((n + 1) level) <= n.
fn needed(level: Level) -> usize {
    // (n + 1) level <= n, solved for n; the neighbours absorb the rounding.
    let estimate = (level.get() / (1.0 - level.get())).ceil() as usize;
    let near = estimate.saturating_sub(1).max(1)..=estimate;
    near.into_iter()
        .find(|&n| rank(n, level) <= n)
        .unwrap_or(estimate.saturating_add(1))
}
