//! Image encoders, the cross-modal tactile estimator and its labels, on candle.
//!
//! Use it to turn photographs into embeddings on a CPU at the speed that the CPU has, to fine-tune
//! the network that makes them, and to estimate what a surface feels like from them (Purri and
//! Dana, "Teaching Cameras to Feel", ECCV 2020). Tensors go in and tensors come out: nothing here
//! reads an image or knows a dataset.
//!
//! ```
//! use candle_core::{DType, Device, Tensor};
//! use sps_models::encoders::{Encoder, EncoderKind, TrainableEncoder};
//!
//! // (batch, channels, height, width), values in 0..=1; any height and width.
//! let images = Tensor::rand(0.0_f32, 1.0, (2, 3, 64, 48), &Device::Cpu)?;
//!
//! // Frozen: `Encoder::load` reads weights from a file instead.
//! let encoder = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0, &Device::Cpu)?;
//! assert_eq!(encoder.embed(&images)?.dims(), [2, encoder.width()]);
//!
//! // Trained: every weight is a variable, with a gradient after the backward pass.
//! let mut encoder = TrainableEncoder::new(&encoder)?;
//! let loss = encoder.forward(&images)?.sqr()?.mean_all()?;
//! let gradients = encoder.backward(&loss)?;
//! assert!(encoder.variables().all(|(_, variable)| gradients.get(variable).is_some()));
//! # Ok::<(), sps_models::Error>(())
//! ```
//!
//! # What is where
//!
//! - [`encoders`]: the networks, frozen ([`encoders::Encoder`]) and trainable
//!   ([`encoders::TrainableEncoder`]).
//! - [`weights`]: their tensors by name, from safetensors and from PyTorch's `.pth` files.
//! - [`ops`]: the operators below them, channels last, differentiable, for networks of your own.
//! - [`heads`]: from an embedding to tactile values; [`ridge`], [`kernel_ridge`] and [`nearest`] are
//!   the floors under it, [`stacking`] is several as one, and all of them a [`Regressor`] whose
//!   models can be kept ([`fitted_from_bytes`]).
//! - [`labels`]: the classes that the cross-modal estimator learns from.
//! - [`training`]: an encoder learns from images, end to end.
//! - [`optim`]: Adam as PyTorch has it.
//!
//! # Features
//!
//! Encoders, operators and weights are always there. The others are on by default:
//!
//! | feature | modules | packages that it brings |
//! |---|---|---|
//! | `heads` | [`heads`], [`labels`] by material, [`optim`] | faer |
//! | `regressions` | `heads`, [`ridge`], [`kernel_ridge`], [`nearest`], [`stacking`] | faer, ndarray |
//! | `clusters` | `regressions`, [`labels`] by k-means | faer, ndarray, linfa |
//! | `training` | [`training`], [`optim`] | |
//!
//! `cuda` and `metal` (off by default) are candle's. On such a device the encoders run by candle's
//! own operators; the kernels of this crate are for the CPU.

#[cfg(feature = "regressions")]
mod archive;
#[cfg(any(feature = "heads", feature = "training"))]
mod data;
#[cfg(feature = "heads")]
mod dense;
pub mod encoders;
mod error;
#[cfg(test)]
mod golden;
#[cfg(feature = "regressions")]
mod groups;
#[cfg(feature = "heads")]
pub mod heads;
#[cfg(feature = "regressions")]
pub mod kernel_ridge;
#[cfg(feature = "heads")]
pub mod labels;
#[cfg(feature = "regressions")]
mod left_out;
#[cfg(feature = "regressions")]
pub mod nearest;
pub mod ops;
#[cfg(any(feature = "heads", feature = "training"))]
pub mod optim;
#[cfg(feature = "regressions")]
mod pca;
#[cfg(feature = "regressions")]
mod regressor;
#[cfg(feature = "regressions")]
pub mod ridge;
#[cfg(feature = "heads")]
mod stacked;
#[cfg(feature = "regressions")]
pub mod stacking;
#[cfg(any(feature = "heads", feature = "training"))]
mod standardise;
#[cfg(feature = "training")]
pub mod training;
pub mod weights;

/// The tensors that go in and come out, in the one version that this crate takes.
pub use candle_core as candle;
#[cfg(any(feature = "heads", feature = "training"))]
pub use data::{Embeddings, Readings};
pub use error::{Error, Result};
#[cfg(feature = "regressions")]
pub use regressor::{FittedRegressor, Regressor, fitted_from_bytes};

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
