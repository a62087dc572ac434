//! Kernels on feature maps, channels last: a map is `(frames, time, height, width, channels)`, laid out as a
//! [`grid::Grid`] says.

// A kernel is compiled with its level's instructions only if all of it is inlined; see `simd`.
#![allow(clippy::inline_always)]

#[macro_use]
mod unroll;

pub(crate) mod activated;
#[cfg(target_arch = "x86_64")]
pub(crate) mod amx;
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
pub(crate) mod outer;
mod outer_tiles;
pub(crate) mod panels;
mod phases;
pub(crate) mod pointwise;
pub(crate) mod pool;
pub(crate) mod product;
mod rows;
pub mod simd;
pub(crate) mod split;
pub(crate) mod statistics;
mod tiles;
mod winograd;
pub(crate) mod words;

#[cfg(test)]
pub(crate) mod tests;
