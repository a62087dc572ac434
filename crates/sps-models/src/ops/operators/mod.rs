//! The kernels as operators of candle, with gradients.

mod conv;
mod max_pool;

use std::sync::{Mutex, PoisonError};

use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Storage, Tensor, bail};

pub use conv::conv;
pub use max_pool::max_pool;

use super::buffer::Buffer;
use super::grid::{Grid, Size};

/// The gradients of an operator's inputs, where there are any.
pub(crate) type InputGradients = [Option<Vec<f32>>; 3];

/// The output of an operator that has run, f32 on the CPU, as a tensor that candle differentiates.
///
/// `backward` gives the inputs' gradients from the output and its gradient: that of every input that
/// is computed from a variable. An operator with fewer inputs names one of them again.
pub(crate) fn differentiable<B>(
    inputs: [&Tensor; 3],
    output: Vec<f32>,
    shape: impl Into<Shape>,
    backward: B,
) -> Result<Tensor>
where
    B: Fn(&[f32], &[f32]) -> Result<InputGradients> + Send + Sync + 'static,
{
    let [first, second, third] = inputs;
    let operator = Operator {
        output: Mutex::new(output),
        shape: shape.into(),
        backward,
    };
    first.apply_op3(second, third, operator)
}

struct Operator<B> {
    /// Until candle takes it.
    output: Mutex<Vec<f32>>,
    shape: Shape,
    backward: B,
}

impl<B> CustomOp3 for Operator<B>
where
    B: Fn(&[f32], &[f32]) -> Result<InputGradients> + Send + Sync,
{
    fn name(&self) -> &'static str {
        "a kernel of sps-models"
    }

    fn cpu_fwd(
        &self,
        _: &CpuStorage,
        _: &Layout,
        _: &CpuStorage,
        _: &Layout,
        _: &CpuStorage,
        _: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let mut output = self.output.lock().unwrap_or_else(PoisonError::into_inner);
        let output = CpuStorage::F32(std::mem::take(&mut output));
        Ok((output, self.shape.clone()))
    }

    fn bwd(
        &self,
        first: &Tensor,
        second: &Tensor,
        third: &Tensor,
        output: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let [a, b, c] = with_values(output, |output| {
            with_values(gradient, |gradient| (self.backward)(output, gradient))
        })?;
        let tensor = |values: Option<Vec<f32>>, like: &Tensor| {
            let values = values.map(|values| Tensor::from_vec(values, like.dims(), like.device()));
            values.transpose()
        };
        Ok((tensor(a, first)?, tensor(b, second)?, tensor(c, third)?))
    }
}

/// Calls `work` with a tensor's numbers, row-major.
pub(crate) fn with_values<T>(tensor: &Tensor, work: impl FnOnce(&[f32]) -> Result<T>) -> Result<T> {
    let tensor = tensor.contiguous()?;
    let (storage, layout) = tensor.storage_and_layout();
    match (&*storage, layout.contiguous_offsets()) {
        (Storage::Cpu(CpuStorage::F32(all)), Some((from, to))) => work(&all[from..to]),
        _ => bail!("a kernel takes f32 tensors on the CPU, not {tensor:?}"),
    }
}

/// Frames, time, height and width, and channels of `(frames, [time,] height, width, channels)`,
/// none of them 0.
fn grid(dims: &[usize]) -> Option<Grid> {
    let (frames, size, channels) = match *dims {
        [frames, height, width, channels] => (frames, [1, height, width], channels),
        [frames, time, height, width, channels] => (frames, [time, height, width], channels),
        _ => return None,
    };
    (!dims.contains(&0)).then(|| Grid::tight(frames, size, channels))
}

/// The dimensions of a feature map, with a time axis where `like` has one.
fn dims(like: &Tensor, frames: usize, size: Size, channels: usize) -> Vec<usize> {
    let size = if like.rank() == 5 { &size } else { &size[1..] };
    [&[frames], size, &[channels]].concat()
}

/// Calls `work` with a feature map's numbers, laid out as `padded` says.
fn with_padding<T>(x: &Tensor, padded: &Grid, work: impl FnOnce(&[f32]) -> T) -> Result<T> {
    with_values(x, |x| {
        Ok(if x.len() == padded.len() {
            work(x)
        } else {
            work(&with_border(x, padded))
        })
    })
}

/// Copies a feature map without a border into one with a border of zeros.
fn with_border(values: &[f32], padded: &Grid) -> Buffer {
    let mut out = Buffer::zeros(padded.len());
    let row = padded.size[2] * padded.channels;
    let firsts = padded.places();
    let firsts = firsts.iter().step_by(padded.size[2]);
    for (row, &first) in values.chunks_exact(row).zip(firsts) {
        out[first..first + row.len()].copy_from_slice(row);
    }
    out
}

/// Copies a feature map out of its border.
fn without_border(values: &[f32], padded: &Grid) -> Vec<f32> {
    let row = padded.size[2] * padded.channels;
    let firsts = padded.places();
    let firsts = firsts.iter().step_by(padded.size[2]);
    firsts
        .flat_map(|&first| &values[first..first + row])
        .copied()
        .collect()
}
