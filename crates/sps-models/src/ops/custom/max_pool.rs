use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};

use super::{dims, grid, values, with_border, with_values, without_border};
use crate::error::Error;
use crate::ops::bands::Threads;
use crate::ops::grid::{Grid, Window};
use crate::ops::pool;
use crate::ops::simd::Level;

/// Max pooling of `(frames, [time,] height, width, channels)`; differentiable.
///
/// The window's padding holds zeros, which take part. With `ceil`, a last window may hang over
/// the upper end of an axis, as with PyTorch's `ceil_mode`, and sees only what there is; an
/// extent smaller than the window is pooled to 1 then.
///
/// The gradient of a window goes to the first of its largest values.
///
/// # Errors
///
/// When the window does not fit the feature map, or the tensor is not f32 on the CPU.
pub fn max_pool(x: &Tensor, window: Window, ceil: bool) -> crate::error::Result<Tensor> {
    let op = MaxPool { window, ceil };
    if op.grids(x.dims()).is_none() {
        let found = format!("{:?} under a window of {:?}", x.dims(), window.size);
        let expected = "(frames, [time,] height, width, channels), no smaller than the window";
        return Err(Error::input("max pooling", found, expected));
    }
    Ok(x.contiguous()?.apply_op1(op)?)
}

struct MaxPool {
    window: Window,
    ceil: bool,
}

impl MaxPool {
    /// The layouts of the input without and with padding, and of the output.
    fn grids(&self, dims: &[usize]) -> Option<(Grid, Grid, Grid)> {
        let from = grid(dims).filter(|grid| grid.len() > 0)?;
        let size = if self.ceil {
            self.window.output_ceil(from.size)
        } else {
            self.window.output(from.size)?
        };
        let to = Grid::tight(from.frames, size, from.channels);
        Some((from, from.padded(&self.window), to))
    }

    fn grids_or_fail(&self, dims: &[usize]) -> Result<(Grid, Grid, Grid)> {
        match self.grids(dims) {
            Some(grids) => Ok(grids),
            None => candle_core::bail!("max pooling of {dims:?}"),
        }
    }
}

impl CustomOp1 for MaxPool {
    fn name(&self) -> &'static str {
        "channels-last max pooling"
    }

    fn cpu_fwd(&self, x: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (from, padded, to) = self.grids_or_fail(layout.dims())?;
        let x = values(x, layout)?;
        let x = with_border(x, &from, &padded);
        let mut y = vec![0.0; to.len()];
        let (level, source) = (Level::detect(), (&x[..], &padded));
        pool::max_pool(Threads::All, level, &self.window, source, (&mut y, &to));
        let dims = dims(layout.dims(), to.frames, to.size, to.channels);
        Ok((CpuStorage::F32(y), Shape::from(dims)))
    }

    fn bwd(&self, x: &Tensor, y: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        let (from, padded, to) = self.grids_or_fail(x.dims())?;
        let mut dx = vec![0.0; padded.len()];
        with_values(x, |x| {
            let x = with_border(x, &from, &padded);
            with_values(y, |y| {
                with_values(gradient, |gradient| {
                    let (source, pooled) = ((&x[..], &padded), (y, &to));
                    let level = Level::detect();
                    pool::max_pool_backward(level, &self.window, source, pooled, gradient, &mut dx);
                    Ok(())
                })
            })
        })?;
        let dx = without_border(&dx, &padded);
        Ok(Some(Tensor::from_vec(dx, x.dims(), x.device())?))
    }
}
