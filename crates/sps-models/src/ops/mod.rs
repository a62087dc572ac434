//! Operators on feature maps, channels last, for the CPU.
//!
//! A feature map is `(frames, [time,] height, width, channels)`, f32. The operators here are
//! operators of candle with gradients; below them lie kernels that run on the widest vectors the
//! machine has.

// A kernel is compiled with its level's instructions only if all of it is inlined; see `simd`.
#![allow(clippy::inline_always)]

#[macro_use]
mod unroll;

pub(crate) mod bands;
pub(crate) mod batch_norm;
pub(crate) mod buffer;
pub(crate) mod conv;
pub(crate) mod conv_input;
pub(crate) mod conv_weight;
mod custom;
pub(crate) mod format;
pub(crate) mod grid;
mod grouped;
pub(crate) mod mean;
pub(crate) mod moments;
mod native;
pub(crate) mod outer;
pub(crate) mod panels;
pub(crate) mod pool;
pub(crate) mod product;
pub(crate) mod residual;
pub(crate) mod simd;

#[cfg(test)]
mod tests;

pub(crate) use custom::with_values;
pub use custom::{BatchNorm, batch_norm, conv, conv_bias, gated_residual, max_pool};
pub use grid::Window;
