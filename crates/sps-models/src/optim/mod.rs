//! The optimiser: Adam, and clipping of a gradient by its norm.

mod adam;
mod clip;
#[cfg(test)]
mod tests;

use candle_core::{Result, Tensor, WithDType};

pub(crate) use adam::Adam;
pub use adam::AdamConfig;
pub(crate) use clip::{clip_scales, squared_norms};

use crate::differentiable::with_values;

/// Something that holds the gradient of one parameter.
pub(crate) trait Gradient {
    /// Shows the elements to `body`, in row-major order; fails where they are of another type.
    fn read<T: WithDType, R>(&self, body: impl FnOnce(&[T]) -> Result<R>) -> Result<R>;
}

impl Gradient for Tensor {
    fn read<T: WithDType, R>(&self, body: impl FnOnce(&[T]) -> Result<R>) -> Result<R> {
        with_values(self, body)
    }
}
