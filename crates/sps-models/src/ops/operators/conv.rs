use candle_core::{Result, Tensor};

use super::{differentiable, dims, grid, with_border, with_padding, with_values};
use crate::error::Error;
use crate::ops::bands::Threads;
use crate::ops::conv::{Conv, ConvShape};
use crate::ops::conv_input::ConvTranspose;
use crate::ops::conv_weight::weight_gradient;
use crate::ops::grid::{Grid, Window};
use crate::ops::product::Epilogue;
use crate::ops::simd::Level;

/// Convolution of `(frames, [time,] height, width, inputs)` by weights
/// `(outputs, inputs / groups, [time,] height, width)`, to
/// `(frames, [time,] height, width, outputs)`; differentiable in both.
///
/// # Errors
///
/// When the shapes do not fit each other, the window does not fit the feature map, or a tensor
/// is not f32 on the CPU.
pub fn conv(
    x: &Tensor,
    weight: &Tensor,
    window: Window,
    groups: usize,
) -> crate::error::Result<Tensor> {
    let layout = Layout::new(x, weight, window, groups)?;
    let y = layout.forward(x, weight)?;
    let dims = dims(x, layout.to.frames, layout.to.size, layout.shape.outputs);
    let inputs = [x, weight, weight];
    let (x, weight) = (x.clone(), weight.clone());
    let backward = move |_: &[f32], gradient: &[f32]| {
        let [dx, dw] = layout.backward(&x, &weight, gradient)?;
        Ok([dx, dw, None])
    };
    Ok(differentiable(inputs, y, dims, backward)?)
}

/// A convolution with the layouts of its input, without padding, and its output.
struct Layout {
    shape: ConvShape,
    from: Grid,
    to: Grid,
}

impl Layout {
    fn new(
        x: &Tensor,
        weight: &Tensor,
        window: Window,
        groups: usize,
    ) -> crate::error::Result<Self> {
        let find = || {
            let from = grid(x.dims())?;
            let (outputs, inputs, size) = match *weight.dims() {
                [outputs, inputs, height, width] => (outputs, inputs, [1, height, width]),
                [outputs, inputs, time, height, width] => (outputs, inputs, [time, height, width]),
                _ => return None,
            };
            let fits = size == window.size
                && inputs.checked_mul(groups) == Some(from.channels)
                && outputs > 0
                && outputs.is_multiple_of(groups);
            let to = window.checked().filter(|_| fits)?.output(from.size)?;
            let shape = ConvShape {
                window,
                inputs: from.channels,
                outputs,
                groups,
            };
            let to = Grid::tight(from.frames, to, outputs);
            Some(Self { shape, from, to })
        };
        find().ok_or_else(|| {
            let (x, weight) = (x.dims(), weight.dims());
            Error::input(
                "convolution",
                format_args!("x {x:?}, weight {weight:?}, {groups} groups, {window:?}"),
                "x (frames, [time,] height, width, inputs), weight (outputs, inputs / groups, \
                 [time,] height, width) of the window's size, and the window, of a stride above 0 \
                 and less padding than its size, within x",
            )
        })
    }

    fn forward(&self, x: &Tensor, weight: &Tensor) -> Result<Vec<f32>> {
        let conv = with_values(weight, |weight| {
            Ok(Conv::pack(Level::detect(), self.shape, weight))
        })?;
        let mut y = vec![0.0; self.to.len()];
        let padded = self.from.padded(&self.shape.window);
        with_padding(x, &padded, |x| {
            let target = (&mut y[..], &self.to);
            conv.apply(Threads::All, (x, &padded), target, Epilogue::default());
        })?;
        Ok(y)
    }

    /// The gradients of the input, where it is wanted, and of the weights.
    fn backward(
        &self,
        x: &Tensor,
        weight: &Tensor,
        gradient: &[f32],
    ) -> Result<[Option<Vec<f32>>; 2]> {
        let (level, from, to) = (Level::detect(), &self.from, &self.to);
        let mut dw = vec![0.0; weight.elem_count()];
        let padded = from.padded(&self.shape.window);
        with_padding(x, &padded, |x| {
            weight_gradient(level, &self.shape, (x, &padded), (gradient, to), &mut dw);
        })?;
        if !x.track_op() {
            return Ok([None, Some(dw)]);
        }
        let transpose = with_values(weight, |weight| {
            Ok(ConvTranspose::pack(level, self.shape, weight))
        })?;
        let layout = transpose.layout(from.frames, from.size, to.size);
        let mut dx = vec![0.0; from.len()];
        transpose.apply(
            (&with_border(gradient, &layout), &layout),
            (&mut dx, from),
            false,
        );
        Ok([Some(dx), Some(dw)])
    }
}
