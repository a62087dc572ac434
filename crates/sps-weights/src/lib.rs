//! Tensors by name from the files that networks' weights come in: safetensors, and a dictionary of tensors as PyTorch's
//! `torch.save` writes it, in the zip format of today or in the stream of versions before 1.6. No tensor library.
//!
//! A pickle is a program. Here it is read by an allow list and runs nothing: an opcode or a global that builds no tensor
//! is refused by name, and memory stays within a small multiple of the file's size.
//!
//! ```
//! use sps_weights::{RawTensor, Storage, read, write};
//!
//! let bias = RawTensor { shape: vec![2], values: vec![0.5, -1.0] };
//! let bytes = write([("head.bias", bias)], Storage::F16, Some(("made-by", "hand")))?;
//! let tensors = read(&bytes)?;
//! assert_eq!((&tensors[0].0[..], &tensors[0].1.values[..]), ("head.bias", &[0.5, -1.0][..]));
//! # Ok::<(), sps_weights::WeightsErrorKind>(())
//! ```

mod error;
mod pytorch;
mod safetensors;

pub use error::{WeightsError, WeightsErrorKind};
pub use safetensors::{note, write};

/// How numbers are kept in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Storage {
    /// As they are.
    F32,
    /// Rounded to 16 bits: half the size, three significant digits.
    F16,
}

/// A tensor as a file holds it, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct RawTensor {
    /// The extents.
    pub shape: Vec<usize>,
    /// As many as the shape has.
    pub values: Vec<f32>,
}

impl RawTensor {
    /// Refuses a value that is not finite, and extents whose product no number holds.
    ///
    /// # Errors
    /// The first such value; such extents.
    pub fn check(&self, name: &str) -> Result<(), WeightsErrorKind> {
        if let Some(index) = self.values.iter().position(|value| !value.is_finite()) {
            let found = self.values[index];
            let what = format!("holds {found} at flat index {index}, expected finite f32 values");
            return Err(WeightsErrorKind::tensor(name, what));
        }
        let size = |size: usize, &extent: &usize| size.checked_mul(extent.max(1));
        if self.shape.iter().try_fold(1, size).is_none() {
            let shape = &self.shape;
            let what = format!("has extents of {shape:?}, whose product no number holds");
            return Err(WeightsErrorKind::tensor(name, what));
        }
        Ok(())
    }
}

/// The tensors of a weights file, each checked; elements of f16, bf16 and f64 become f32. The content tells the format.
///
/// # Errors
/// Bytes of no such format, elements of another type, a value that is not finite as f32.
pub fn read(bytes: &[u8]) -> Result<Vec<(String, RawTensor)>, WeightsErrorKind> {
    let tensors = pytorch::read(bytes).unwrap_or_else(|| safetensors::read(bytes))?;
    for (name, tensor) in &tensors {
        tensor.check(name)?;
    }
    Ok(tensors)
}

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
