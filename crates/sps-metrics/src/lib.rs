#![doc = include_str!("../README.md")]

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
pub use interval::{IntervalError, Intervals, ScoreInterval, Scored, Side, holm};
pub use level::{InvalidLevel, Level};
pub use moments::Moments;
pub use outcome::{NonFiniteKind, Outcome, Quantity, Score, Undefined};
pub use properties::{PropertyMean, PropertyScore, mean_over_all, mean_over_best, mean_over_named};
pub use reruns::{RerunSummary, over_reruns};
pub use samples::{Better, Metric, Pair, Samples, Scores, TrainingMean};
