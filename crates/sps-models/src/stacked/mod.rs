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

use candle_core::{CpuStorage, Layout, Result, Shape, Storage, Tensor, bail};

/// The two element types, and how to see them in candle's storage.
pub(crate) trait Element: candle_core::WithDType + faer::traits::RealField {
    fn slice(storage: &CpuStorage) -> Option<&[Self]>;
    fn slice_mut(storage: &mut CpuStorage) -> Option<&mut [Self]>;
    fn storage(values: Vec<Self>) -> CpuStorage;
}

macro_rules! element {
    ($type:ty, $variant:ident) => {
        impl Element for $type {
            fn slice(storage: &CpuStorage) -> Option<&[Self]> {
                match storage {
                    CpuStorage::$variant(values) => Some(values),
                    _ => None,
                }
            }

            fn slice_mut(storage: &mut CpuStorage) -> Option<&mut [Self]> {
                match storage {
                    CpuStorage::$variant(values) => Some(values),
                    _ => None,
                }
            }

            fn storage(values: Vec<Self>) -> CpuStorage {
                CpuStorage::$variant(values)
            }
        }
    };
}

element!(f32, F32);
element!(f64, F64);

/// The elements of a contiguous tensor.
fn elements<'a, T: Element>(
    operator: &str,
    storage: &'a CpuStorage,
    layout: &Layout,
) -> Result<&'a [T]> {
    let Some(values) = T::slice(storage) else {
        bail!("{operator}: operands of different types")
    };
    match layout.contiguous_offsets() {
        Some((start, end)) => Ok(&values[start..end]),
        None => bail!("{operator}: an operand is not contiguous"),
    }
}

/// Runs `body` on the elements of a tensor on the CPU.
fn with_elements<T: Element, R>(
    operator: &str,
    tensor: &Tensor,
    body: impl FnOnce(&[T]) -> Result<R>,
) -> Result<R> {
    let tensor = tensor.contiguous()?;
    let (storage, layout) = tensor.storage_and_layout();
    match &*storage {
        Storage::Cpu(storage) => body(elements(operator, storage, layout)?),
        _ => bail!("{operator}: a tensor is not on the CPU"),
    }
}

/// Says the same for either element type, which `$type` stands for, by that of a storage.
macro_rules! for_element {
    ($operator:expr, $storage:expr, $type:ident => $call:expr) => {
        match $storage.dtype() {
            candle_core::DType::F32 => {
                type $type = f32;
                $call
            }
            candle_core::DType::F64 => {
                type $type = f64;
                $call
            }
            other => candle_core::bail!("{}: {other:?} is neither f32 nor f64", $operator),
        }
    };
}
use for_element;

type Output = Result<(CpuStorage, Shape)>;
