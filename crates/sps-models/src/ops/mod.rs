//! Operators on feature maps, channels last, for the CPU.
//!
//! A feature map is `(frames, [time,] height, width, channels)`, f32. The operators here are
//! operators of candle with gradients; below them lie kernels that run on the widest vectors the
//! machine has.
//!
//! ```
//! use candle_core::{DType, Device, Tensor, Var};
//! use sps_models::ops::{Window, conv, max_pool};
//!
//! // Two images of 32 x 24 pixels with 3 channels each, and 8 windows of 3 x 3.
//! let images = Tensor::rand(0.0_f32, 1.0, (2, 32, 24, 3), &Device::Cpu)?;
//! let weight = Var::rand(-0.1_f32, 0.1, (8, 3, 3, 3), &Device::Cpu)?;
//! let features = conv(&images, &weight, Window::square(3, 1, 1), 1)?;
//! let pooled = max_pool(&features, Window::square(2, 2, 0), false)?;
//! assert_eq!(pooled.dims(), [2, 16, 12, 8]);
//!
//! let gradients = pooled.sum_all()?.backward()?;
//! assert_eq!(gradients.get(&weight).map(Tensor::dtype), Some(DType::F32));
//! # Ok::<(), sps_models::Error>(())
//! ```

// A kernel is compiled with its level's instructions only if all of it is inlined; see `simd`.
#![allow(clippy::inline_always)]

#[macro_use]
mod unroll;

pub(crate) mod activated;
pub(crate) mod bands;
pub(crate) mod batch_norm;
pub(crate) mod buffer;
pub(crate) mod conv;
pub(crate) mod conv_input;
pub(crate) mod conv_weight;
mod depthwise;
mod depthwise_bytes;
pub(crate) mod grid;
mod grouped;
pub(crate) mod image;
pub(crate) mod mean;
mod native;
mod operators;
pub(crate) mod outer;
pub(crate) mod panels;
pub(crate) mod pool;
pub(crate) mod product;
pub(crate) mod residual;
pub(crate) mod simd;
pub(crate) mod statistics;
mod winograd;
pub(crate) mod words;

#[cfg(test)]
mod tests;

pub use grid::Window;
pub use operators::{conv, max_pool};
pub(crate) use operators::{differentiable, with_values};
