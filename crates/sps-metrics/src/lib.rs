//! Scores of regression models over surfaces and reruns: R², MAE, RMSE, median percentage error,
//! Spearman's correlation, means over properties, and intervals that can be trusted.
//!
//! Use it where a number goes into a table and has to be right: on values like 1e8 + small, on
//! truths that are zero, on a constant truth, on streams that arrive in parts. A score that cannot
//! be computed is an [`Undefined`] that says why, never NaN and never a number with an epsilon in
//! its denominator. Truth and estimate go in by name and cannot be swapped silently.
//!
//! The scores are those of Purri and Dana, "Teaching Cameras to Feel", ECCV 2020 (section 5,
//! "Evaluation Metric"), with the ones readers ask for beside them.
//!
//! ```
//! use sps_metrics::{Intervals, Level, Metric, Samples, Scored, TrainingMean, Undefined};
//!
//! let samples = Samples {
//!     truth: &[12.0, 35.0, 0.0, 61.0, 44.0, 27.0],
//!     estimate: &[15.0, 33.0, 4.0, 58.0, 49.0, 27.0],
//! };
//! let training_mean = TrainingMean::of(&[20.0, 40.0, 36.0])?;
//!
//! // R² as the paper writes it: against the mean of the training split.
//! let r2 = samples.r2(training_mean)?;
//! assert_eq!(r2.value, 1.0 - 63.0 / 2443.0);
//!
//! // A truth of zero has no percentage: it is left out and counted.
//! let percent = samples.median_percent_error()?;
//! assert_eq!((percent.samples, percent.zero_truths), (5, 1));
//!
//! // 95 % interval of this one model, on other surfaces.
//! let interval = Intervals::of_models(Level::P95).interval(&[Scored {
//!     metric: Metric::R2(training_mean),
//!     samples,
//!     units: None,
//!     rerun: 0,
//! }])?;
//! assert!(interval.low < r2.value && r2.value < interval.high);
//!
//! // What has no score says so.
//! let constant = Samples { truth: &[0.1; 10], estimate: &[0.2; 10] };
//! assert_eq!(constant.r2_own_mean(), Err(Undefined::ConstantTruth { value: 0.1 }));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is where
//!
//! - One property: [`Samples`] has every score as a method; [`Metric`] names them, [`Scores`] holds
//!   them all.
//! - Several properties: [`mean_over_all`], [`mean_over_named`] (the paper's fixed eight) and
//!   [`mean_over_best`] (the eight best of this run) average, and report what they had to leave out.
//! - Streams: [`ScoreAccumulator`] and [`Moments`] take one value at a time and merge. Any order and
//!   any split give the same result within 1e-12 relative.
//! - Reruns: [`over_reruns`] gives mean and sample standard deviation.
//! - Chance: [`Intervals`] gives the interval of a score, of a mean over properties, and of the
//!   difference of two methods, over units (surfaces, or groups of them) and reruns; [`holm`]
//!   corrects p-values for how many were looked at.
//! - Predictions: [`SplitConformal`] gives intervals that cover at a promised rate, and
//!   [`GroupConformal`] where samples come in groups and the next is of a new one; [`coverage`]
//!   says whether they did.
//!
//! The feature `serde` (off by default) makes scores, reasons and intervals readable and writable.

mod accumulate;
mod conformal;
mod double;
mod interval;
mod level;
mod moments;
mod outcome;
mod properties;
mod reruns;
mod samples;
mod screen;

pub use accumulate::ScoreAccumulator;
pub use conformal::{
    ConformalError, Coverage, GroupConformal, PredictionInterval, SplitConformal, coverage,
};
pub use interval::{IntervalError, Intervals, ScoreInterval, Scored, holm};
pub use level::{InvalidLevel, Level};
pub use moments::Moments;
pub use outcome::{NonFiniteKind, Outcome, Quantity, Score, Undefined};
pub use properties::{PropertyMean, PropertyScore, mean_over_all, mean_over_best, mean_over_named};
pub use reruns::{RerunSummary, over_reruns};
pub use samples::{Better, Metric, Pair, Samples, Scores, TrainingMean};

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
