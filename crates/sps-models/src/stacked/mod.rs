//! Differentiable operators over a stack of independent trials.
//!
//! Tensors carry the trials along their first axis. No operator mixes two trials, none splits the
//! work of one trial over threads, and each computes a trial by calls whose shapes do not depend
//! on the others: so a trial gives the same bits in any stack. On the CPU, f32 and f64.

#[cfg(test)]
pub(crate) mod tests;

mod linear;
mod parameter;
mod rows;

pub(crate) use linear::{linear, matmul};
pub(crate) use parameter::{GradientSlot, Parameter};
pub(crate) use rows::{cross_entropy, leaky_relu, row_norm, softplus};

use std::ops::Range;

use candle_core::CpuStorage;

/// The two element types.
pub(crate) trait Element: candle_core::WithDType + faer::traits::RealField {
    /// What a storage of this type holds.
    fn slice_mut(storage: &mut CpuStorage) -> Option<&mut [Self]>;
}

macro_rules! element {
    ($type:ty, $variant:ident) => {
        impl Element for $type {
            fn slice_mut(storage: &mut CpuStorage) -> Option<&mut [Self]> {
                match storage {
                    CpuStorage::$variant(values) => Some(values),
                    _ => None,
                }
            }
        }
    };
}

element!(f32, F32);
element!(f64, F64);

/// Says the same for either element type, which `$type` stands for, by that of a tensor.
macro_rules! for_element {
    ($tensor:expr, $type:ident => $call:expr) => {
        match $tensor.dtype() {
            candle_core::DType::F32 => {
                type $type = f32;
                $call
            }
            candle_core::DType::F64 => {
                type $type = f64;
                $call
            }
            other => {
                candle_core::bail!("{}: {other:?} is neither f32 nor f64", stringify!($tensor))
            }
        }
    };
}
pub(crate) use for_element;

/// Where a trial's numbers lie, `length` for each.
fn part(trial: usize, length: usize) -> Range<usize> {
    trial * length..(trial + 1) * length
}
