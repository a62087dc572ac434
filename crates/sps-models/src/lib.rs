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
//! let encoder = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?;
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
//! - [`heads`]: from an embedding to tactile values. They are a regressor beside those of `sps-regress`, which
//!   takes [`Embeddings`](embeddings_of) too; models of both are read by [`fitted_from_bytes`].
//! - [`labels`]: the classes that the cross-modal estimator learns from.
//! - [`training`]: an encoder learns from images, end to end.
//! - [`optim`]: the settings of the optimiser.
//!
//! # Features
//!
//! Encoders and weights are always there. The others are on by default:
//!
//! | feature | modules | packages that it brings |
//! |---|---|---|
//! | `heads` | [`heads`], [`labels`] by material, [`training`], [`optim`] | sps-regress with faer and ndarray |
//! | `clusters` | `heads`, [`labels`] by k-means | linfa too |

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

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
