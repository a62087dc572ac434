//! Intervals over units: surfaces, or groups of surfaces.

mod draw;
mod kernel;
mod plan;

use thiserror::Error;

use crate::level::{Level, steps};
use crate::metric::Metric;
use crate::outcome::Undefined;
use crate::samples::Samples;
use draw::Draws;
use plan::{Plan, Side};

/// Percentile bootstrap over units (Efron and Tibshirani, "An Introduction to the Bootstrap",
/// 1993, chapter 13): how far a score would move if other units of the same kind had been tested.
///
/// A unit is what was drawn independently: a surface, or where surfaces come in groups whose
/// members are alike (pieces of one material) the group. Units are drawn with replacement, each
/// with all of its samples, as many as there are (the cluster bootstrap: Davison and Hinkley,
/// "Bootstrap Methods and their Application", 1997, section 3.8). With B resamples and
/// k = floor((B + 1)(1 - level) / 2) the interval runs from the k-th smallest to the k-th largest
/// score. The same seed draws the same units for every score and method; draws come from one
/// `ChaCha` stream per resample, so the result is the same bits on every machine.
///
/// ```
/// use sps_metrics::{Bootstrap, Compared, Metric, Samples, Scored};
///
/// let truth: Vec<f64> = (0..40).map(f64::from).collect();
/// let rough: Vec<f64> = truth.iter().map(|t| t + 4.0 * (t * 7.0).sin()).collect();
/// let fine: Vec<f64> = truth.iter().map(|t| t + 1.0 * (t * 5.0).sin()).collect();
///
/// let bootstrap = Bootstrap::new(1);
/// let mae = bootstrap.interval(&Scored {
///     metric: Metric::Mae,
///     samples: Samples { truth: &truth, estimate: &rough },
///     units: None, // each sample is a unit of its own
/// })?;
/// assert!(mae.low < mae.estimate && mae.estimate < mae.high);
///
/// let gain = bootstrap.difference(&Compared {
///     metric: Metric::Mae,
///     truth: &truth,
///     first: &rough,
///     second: &fine,
///     units: None,
/// })?;
/// assert!(gain.excludes_zero() && gain.estimate > 0.0);
/// # Ok::<(), sps_metrics::BootstrapError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bootstrap {
    seed: u64,
    resamples: usize,
    level: Level,
}

/// One method's estimates of one property, to be scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scored<'a> {
    /// The score.
    pub metric: Metric,
    /// The samples, `(samples)`.
    pub samples: Samples<'a>,
    /// The unit that each sample comes from, by any numbers, `(samples)`: its surface, or its group
    /// of surfaces where those of a group are alike. `None` where each sample is a unit of its own.
    /// Over several properties equal numbers are one unit.
    pub units: Option<&'a [usize]>,
}

/// Two methods' estimates of one property, `(samples)` each in the same order, to be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compared<'a> {
    /// The score.
    pub metric: Metric,
    /// The measured values.
    pub truth: &'a [f64],
    /// The first method's values.
    pub first: &'a [f64],
    /// The second method's values.
    pub second: &'a [f64],
    /// As [`Scored::units`].
    pub units: Option<&'a [usize]>,
}

/// A score with its bootstrap interval.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BootstrapInterval {
    /// The score of the samples as they are, or the first method's less the second's.
    pub estimate: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
    /// The share of resamples between the ends.
    pub level: Level,
    /// How many units were drawn from: surfaces, or groups of them.
    pub units: usize,
    /// How many resamples were drawn.
    pub resamples: usize,
    /// How many resamples have no score (for example because they drew equal truths only). Each
    /// counts as lying beyond both ends, so it can only widen the interval.
    pub undefined_resamples: usize,
}

/// Why there is no interval.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum BootstrapError {
    /// The score itself has no value.
    #[error("the score is undefined: {0}")]
    Undefined(#[from] Undefined),
    /// Every resample would be the same.
    #[error("{found} unit(s) (surfaces or groups) to draw from, a bootstrap needs at least 2")]
    TooFewUnits {
        /// How many there are.
        found: usize,
    },
    /// Units are counted in 32 bits.
    #[error("{found} units, more than 2^32 - 1")]
    TooManyUnits {
        /// How many there are.
        found: usize,
    },
    /// The ends of the interval lie outside of the resamples.
    #[error("{found} resamples, a level of {} needs at least {needed}", level.get())]
    TooFewResamples {
        /// How many were asked for.
        found: usize,
        /// How many the level needs.
        needed: usize,
        /// The level asked for.
        level: Level,
    },
    /// So many resamples have no score that an end of the interval may be anywhere.
    #[error("{undefined} of {resamples} resamples have no score, the first because: {first}")]
    UndefinedResamples {
        /// How many have none.
        undefined: usize,
        /// How many were drawn.
        resamples: usize,
        /// Why the first of them has none.
        first: Undefined,
    },
    /// Samples and unit numbers do not pair up.
    #[error("{units} unit numbers for {samples} samples")]
    UnitMismatch {
        /// How many samples there are.
        samples: usize,
        /// How many unit numbers there are.
        units: usize,
    },
}

impl BootstrapInterval {
    /// Whether zero lies outside of the interval: for a difference, whether the methods differ.
    pub fn excludes_zero(&self) -> bool {
        self.low > 0.0 || self.high < 0.0
    }

    /// The distance between the ends.
    pub fn width(&self) -> f64 {
        self.high - self.low
    }
}

impl Bootstrap {
    /// 2000 resamples, 95 %.
    pub const fn new(seed: u64) -> Self {
        Self {
            seed,
            resamples: 2000,
            level: Level::P95,
        }
    }

    /// With another number of resamples.
    #[must_use]
    pub const fn with_resamples(mut self, resamples: usize) -> Self {
        self.resamples = resamples;
        self
    }

    /// With another level.
    #[must_use]
    pub const fn with_level(mut self, level: Level) -> Self {
        self.level = level;
        self
    }

    /// The interval of a score.
    ///
    /// # Errors
    ///
    /// Any [`BootstrapError`].
    pub fn interval(&self, scored: &Scored<'_>) -> Result<BootstrapInterval, BootstrapError> {
        self.mean_interval(std::slice::from_ref(scored))
    }

    /// The interval of the mean of several scores, such as R² over all properties. Where a unit is
    /// drawn, it is drawn for all of them.
    ///
    /// # Errors
    ///
    /// Any [`BootstrapError`]; one score that has no value leaves the mean without one, so leave
    /// out beforehand what [`mean_over_all`](crate::mean_over_all) reports as left out.
    pub fn mean_interval(
        &self,
        scored: &[Scored<'_>],
    ) -> Result<BootstrapInterval, BootstrapError> {
        self.run(&Plan::new(
            scored.iter().map(|scored| (Side::First, *scored)),
        )?)
    }

    /// The interval of the difference between two methods' scores, first less second, where both
    /// are scored on the same drawn units.
    ///
    /// # Errors
    ///
    /// Any [`BootstrapError`].
    pub fn difference(&self, compared: &Compared<'_>) -> Result<BootstrapInterval, BootstrapError> {
        self.mean_difference(std::slice::from_ref(compared))
    }

    /// The interval of the difference between two methods' mean over several scores.
    ///
    /// # Errors
    ///
    /// As [`mean_interval`](Self::mean_interval).
    pub fn mean_difference(
        &self,
        compared: &[Compared<'_>],
    ) -> Result<BootstrapInterval, BootstrapError> {
        let sides = compared.iter().flat_map(|compared| {
            [
                (Side::First, compared.side(compared.first)),
                (Side::Second, compared.side(compared.second)),
            ]
        });
        self.run(&Plan::new(sides)?)
    }

    fn run(&self, plan: &Plan<'_>) -> Result<BootstrapInterval, BootstrapError> {
        let tail = self.tail()?;
        let draws = Draws::new(self.seed);
        let mut scratch = plan.scratch();
        let mut scores = Vec::new();
        let mut first_undefined = None;
        for resample in 0..self.resamples as u64 {
            draws.fill(resample, &mut scratch.counts, plan.units);
            match plan.value(&mut scratch) {
                Ok(score) => scores.push(score),
                Err(reason) => first_undefined = first_undefined.or(Some(reason)),
            }
        }
        let undefined = self.resamples - scores.len();
        match first_undefined {
            Some(first) if undefined >= tail => {
                return Err(BootstrapError::UndefinedResamples {
                    undefined,
                    resamples: self.resamples,
                    first,
                });
            }
            _ => {}
        }
        scores.sort_unstable_by(f64::total_cmp);
        let outside = tail - undefined;
        Ok(BootstrapInterval {
            estimate: plan.estimate,
            low: scores[outside - 1],
            high: scores[scores.len() - outside],
            level: self.level,
            units: plan.units as usize,
            resamples: self.resamples,
            undefined_resamples: undefined,
        })
    }

    /// How many resamples lie at or beyond each end.
    fn tail(&self) -> Result<usize, BootstrapError> {
        let outside = |resamples: usize| {
            let places = resamples.saturating_add(1);
            ((places as f64 - steps(places, self.level.get())) / 2.0).floor() as usize
        };
        match outside(self.resamples) {
            0 => {
                let estimate = (2.0 / (1.0 - self.level.get())).ceil() as usize;
                let near = estimate.saturating_sub(2)..=estimate;
                let needed = near.into_iter().find(|&resamples| outside(resamples) > 0);
                Err(BootstrapError::TooFewResamples {
                    found: self.resamples,
                    needed: needed.unwrap_or(estimate),
                    level: self.level,
                })
            }
            tail => Ok(tail),
        }
    }
}

impl<'a> Compared<'a> {
    fn side(&self, estimate: &'a [f64]) -> Scored<'a> {
        Scored {
            metric: self.metric,
            samples: Samples {
                truth: self.truth,
                estimate,
            },
            units: self.units,
        }
    }
}
