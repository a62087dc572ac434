//! The kernels as operators of candle, with gradients.

mod batch_norm;
mod conv;
mod max_pool;
mod residual;

use std::borrow::Cow;

use candle_core::{CpuStorage, Layout, Result, Storage, Tensor, bail};

pub use batch_norm::{BatchNorm, batch_norm};
pub use conv::{conv, conv_bias};
pub use max_pool::max_pool;
pub use residual::gated_residual;

use super::buffer::Buffer;
use super::grid::{Grid, Size};

/// A contiguous tensor's numbers.
fn values<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    match (storage, layout.contiguous_offsets()) {
        (CpuStorage::F32(all), Some((from, to))) => Ok(&all[from..to]),
        _ => bail!("this operator takes contiguous f32 tensors"),
    }
}

/// Calls `work` with a tensor's numbers, row-major.
pub(crate) fn with_values<T>(tensor: &Tensor, work: impl FnOnce(&[f32]) -> Result<T>) -> Result<T> {
    let tensor = tensor.contiguous()?;
    let (storage, layout) = tensor.storage_and_layout();
    match &*storage {
        Storage::Cpu(storage) => work(values(storage, layout)?),
        _ => bail!("this operator runs on the CPU"),
    }
}

/// Frames, time, height and width, and channels of `(frames, [time,] height, width, channels)`.
fn grid(dims: &[usize]) -> Option<Grid> {
    match *dims {
        [frames, height, width, channels] => {
            Some(Grid::tight(frames, [1, height, width], channels))
        }
        [frames, time, height, width, channels] => {
            Some(Grid::tight(frames, [time, height, width], channels))
        }
        _ => None,
    }
}

/// The dimensions of a feature map, with a time axis where `like` has one.
fn dims(like: &[usize], frames: usize, size: Size, channels: usize) -> Vec<usize> {
    let mut dims = vec![frames];
    dims.extend_from_slice(if like.len() == 5 { &size } else { &size[1..] });
    dims.push(channels);
    dims
}

/// Copies a feature map without a border into one with a border of zeros.
fn with_border<'a>(values: &'a [f32], tight: &Grid, padded: &Grid) -> Cow<'a, [f32]> {
    if tight == padded {
        return Cow::Borrowed(values);
    }
    let mut out = Buffer::zeros(padded.len());
    let rows = values.chunks_exact(tight.size[2] * tight.channels);
    let firsts = padded.places();
    for (row, first) in rows.zip(firsts.iter().step_by(tight.size[2])) {
        let first = *first as usize;
        out[first..first + row.len()].copy_from_slice(row);
    }
    Cow::Owned(out.to_vec())
}

/// Copies a feature map out of its border.
fn without_border(values: &[f32], padded: &Grid) -> Vec<f32> {
    let row = padded.size[2] * padded.channels;
    let firsts = padded.places();
    let firsts = firsts.iter().step_by(padded.size[2].max(1));
    firsts
        .flat_map(|&first| &values[first as usize..first as usize + row])
        .copied()
        .collect()
}
