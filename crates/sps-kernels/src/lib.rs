//! Convolutional networks on the CPU, forward and backward: a network as a list of layers and its tensors as
//! slices in, embeddings and gradients out. f32, bf16 and int8; no tensor library, no files.
//!
//! - [`network`]: a network as data. Its tensors, multiply-adds and widths follow from the list of its layers.
//!   [`networks`] has some: SqueezeNet, ResNet, SE-ResNeXt, EfficientNet-Lite, I3D.
//! - [`inference`]: images to embeddings, in four precisions.
//! - [`training`]: a forward pass that is kept, and its backward pass.
//! - [`Convolution`] and [`MaxPooling`]: one operator on slices, with its gradients.
//! - [`simd`]: vector code of your own, compiled for each instruction set.
//!
//! All run on the widest vectors that the machine has: AVX-512, AVX2, NEON, or none by name; bf16 and int8 on Intel's
//! matrix tiles (AMX). `SPS_INSTRUCTIONS=portable`, `avx2`, `avx512`, `amx` or `neon` takes others ([`simd::Level::detect`]).

mod error;
#[cfg(test)]
mod golden;
mod images;
pub mod inference;
pub mod network;
pub mod networks;
mod operators;
mod ops;
mod precision;
mod tensors;
pub mod training;
mod windows;

pub use error::{Error, Result};
pub use images::{Images, Normalisation, Order};
pub use operators::{Convolution, MaxPooling};
pub use ops::conv::ConvShape;
pub use ops::grid::{Size, Window};
pub use ops::product::Activation;
pub use ops::simd;
pub use precision::Precision;
pub use sps_base::Unexpected;
pub use tensors::{TensorSpec, Tensors};
pub use windows::{CellSums, WindowEmbeddings, Windows};

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
