//! Image encoders, the cross-modal tactile estimator and its labels, on candle.

mod data;
pub mod encoders;
mod error;
#[cfg(test)]
mod golden;
pub mod heads;
pub mod labels;
pub mod ops;
pub mod optim;
pub mod ridge;
mod rng;
mod stacked;
pub mod training;
pub mod weights;

pub use data::{Embeddings, Readings};
pub use error::{Error, Result};
