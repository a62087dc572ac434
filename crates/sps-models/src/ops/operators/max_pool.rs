use candle_core::Tensor;

use super::{differentiable, dims, grid, with_padding, without_border};
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
    let find = || {
        let (from, window) = (grid(x.dims())?, window.checked()?);
        let size = if ceil {
            window.output_ceil(from.size)
        } else {
            window.output(from.size)?
        };
        let to = Grid::tight(from.frames, size, from.channels);
        Some((from.padded(&window), to))
    };
    let (from, to) = find().ok_or_else(|| {
        Error::input(
            "max pooling",
            format_args!("{:?} under {window:?}", x.dims()),
            "(frames, [time,] height, width, channels), no smaller than the window, of a stride \
             above 0 and less padding than its size",
        )
    })?;
    let level = Level::detect();
    let mut y = vec![0.0; to.len()];
    with_padding(x, &from, |x| {
        pool::max_pool(Threads::All, level, &window, (x, &from), (&mut y, &to));
    })?;
    let input = x.clone();
    let backward = move |y: &[f32], gradient: &[f32]| {
        let mut dx = vec![0.0; from.len()];
        with_padding(&input, &from, |x| {
            pool::max_pool_backward(level, &window, (x, &from), (y, &to), gradient, &mut dx);
        })?;
        Ok([Some(without_border(&dx, &from)), None, None])
    };
    let dims = dims(x, to.frames, to.size, to.channels);
    Ok(differentiable([x, x, x], y, dims, backward)?)
}
