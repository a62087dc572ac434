#![doc = include_str!("../README.md")]

mod differentiable;
pub mod encoders;
mod error;
#[cfg(test)]
mod golden;
#[cfg(feature = "heads")]
pub mod heads;
#[cfg(feature = "heads")]
pub mod labels;
#[cfg(feature = "heads")]
pub mod optim;
#[cfg(feature = "heads")]
mod stacked;
#[cfg(feature = "heads")]
pub mod training;
pub mod weights;

/// The tensors that go in and come out, in the one version that this crate takes.
pub use candle_core as candle;
pub use error::{Error, Result};
#[cfg(feature = "heads")]
pub use heads::regressor::{embeddings_of, fitted_from_bytes};
pub use sps_base::Unexpected;
