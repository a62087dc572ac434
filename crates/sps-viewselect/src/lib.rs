#![doc = include_str!("../README.md")]

mod adam;
mod any;
mod baselines;
mod critic;
mod error;
mod evaluator;
mod exhaustive;
#[cfg(test)]
mod golden;
mod greedy;
mod loss;
mod nvs;
mod policy;
mod problem;
mod reinforce;
mod relations;
mod remembered;
mod selection;
mod sets;
mod shared;
mod softmax;
mod stream;
mod value;
mod value_search;
mod vb_nvs;
mod vector;

pub use any::AnySelector;
pub use baselines::{Equidistant, EquidistantAt, Nadir, Random};
pub use error::SelectError;
pub use exhaustive::Exhaustive;
pub use greedy::Greedy;
pub use loss::{LossError, SetFunction, SetLoss};
pub use nvs::Nvs;
pub use problem::{Problem, Selector};
pub use reinforce::{Baseline, PolicyTraining};
pub use relations::{RelationSampler, Relations, TemporalRelations};
pub use remembered::Remembered;
pub use selection::{CurvePoint, Selection};
pub use sets::Sets;
pub use shared::{Pooled, SharedLoss};
pub use vb_nvs::{ValueSearch, ValueTraining, VbNvs};
