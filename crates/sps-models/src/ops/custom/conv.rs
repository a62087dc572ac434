use candle_core::{CpuStorage, CustomOp2, CustomOp3, Layout, Result, Shape, Tensor};

use super::{dims, grid, values, with_border, with_values};
use crate::error::Error;
use crate::ops::bands::Threads;
use crate::ops::conv::{Conv, ConvShape};
use crate::ops::conv_input::ConvTranspose;
use crate::ops::conv_weight::weight_gradient;
use crate::ops::grid::{Grid, Window};
use crate::ops::product::{Columns, Epilogue};
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
    let op = ConvOp::new(x, weight, window, groups, false)?;
    Ok(x.contiguous()?.apply_op2(&weight.contiguous()?, op)?)
}

/// Convolution as [`conv`], plus a bias `(outputs)`, rectified where `relu` says so.
///
/// # Errors
///
/// As [`conv`].
pub fn conv_bias(
    x: &Tensor,
    weight: &Tensor,
    bias: &Tensor,
    window: Window,
    groups: usize,
    relu: bool,
) -> crate::error::Result<Tensor> {
    let op = ConvOp::new(x, weight, window, groups, relu)?;
    if bias.dims() != [op.shape.outputs] {
        let expected = format!("({})", op.shape.outputs);
        return Err(Error::input(
            "bias",
            format_args!("{:?}", bias.dims()),
            expected,
        ));
    }
    let (weight, bias) = (weight.contiguous()?, bias.contiguous()?);
    Ok(x.contiguous()?.apply_op3(&weight, &bias, op)?)
}

struct ConvOp {
    shape: ConvShape,
    relu: bool,
}

impl ConvOp {
    fn new(
        x: &Tensor,
        weight: &Tensor,
        window: Window,
        groups: usize,
        relu: bool,
    ) -> crate::error::Result<Self> {
        let found = || {
            format!(
                "x {:?}, weight {:?}, {groups} groups",
                x.dims(),
                weight.dims()
            )
        };
        let expected = "x (frames, [time,] height, width, inputs), weight (outputs, inputs / groups, \
                        [time,] height, width) of the window's size, and the window within x";
        let error = || Error::input("convolution", found(), expected);
        let from = grid(x.dims()).ok_or_else(error)?;
        let (outputs, inputs, size) = match *weight.dims() {
            [outputs, inputs, height, width] => (outputs, inputs, [1, height, width]),
            [outputs, inputs, time, height, width] => (outputs, inputs, [time, height, width]),
            _ => return Err(error()),
        };
        let fits = size == window.size
            && groups > 0
            && inputs * groups == from.channels
            && outputs % groups == 0
            && outputs > 0
            && from.len() > 0
            && window.output(from.size).is_some();
        if !fits {
            return Err(error());
        }
        let shape = ConvShape {
            window,
            inputs: from.channels,
            outputs,
            groups,
        };
        Ok(Self { shape, relu })
    }

    /// The layouts of the input and of the output.
    fn grids(&self, dims: &[usize]) -> Result<(Grid, Grid)> {
        let from = grid(dims);
        let to = from.and_then(|from| {
            let size = self.shape.window.output(from.size)?;
            Some(Grid::tight(from.frames, size, self.shape.outputs))
        });
        match (from, to) {
            (Some(from), Some(to)) => Ok((from, to)),
            _ => candle_core::bail!("convolution of {dims:?}"),
        }
    }

    fn forward(
        &self,
        (x, x_layout): (&CpuStorage, &Layout),
        (weight, weight_layout): (&CpuStorage, &Layout),
        bias: Option<&[f32]>,
    ) -> Result<(CpuStorage, Shape)> {
        let (from, to) = self.grids(x_layout.dims())?;
        let padded = from.padded(&self.shape.window);
        let x = values(x, x_layout)?;
        let x = with_border(x, &from, &padded);
        let conv = Conv::pack(Level::detect(), self.shape, values(weight, weight_layout)?);
        let mut y = vec![0.0; to.len()];
        let epilogue = Epilogue {
            shift: bias.map(Columns::shared),
            relu: self.relu,
            ..Epilogue::default()
        };
        conv.apply(Threads::All, (&x, &padded), (&mut y, &to), epilogue);
        let dims = dims(x_layout.dims(), to.frames, to.size, to.channels);
        Ok((CpuStorage::F32(y), Shape::from(dims)))
    }

    /// The gradients of the input, where it is wanted, and of the weights.
    fn backward(
        &self,
        x: &Tensor,
        weight: &Tensor,
        gradient: &[f32],
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (from, to) = self.grids(x.dims())?;
        let device = x.device();
        let input = if x.track_op() {
            let dx = with_values(weight, |weight| {
                Ok(self.input_gradient(weight, gradient, &from, &to))
            })?;
            Some(Tensor::from_vec(dx, x.dims(), device)?)
        } else {
            None
        };
        let padded = from.padded(&self.shape.window);
        let mut dw = vec![0.0; weight.elem_count()];
        with_values(x, |x| {
            let x = with_border(x, &from, &padded);
            let (source, gradient) = ((&x[..], &padded), (gradient, &to));
            weight_gradient(Level::detect(), &self.shape, source, gradient, &mut dw);
            Ok(())
        })?;
        Ok((input, Some(Tensor::from_vec(dw, weight.dims(), device)?)))
    }

    fn input_gradient(&self, weight: &[f32], gradient: &[f32], from: &Grid, to: &Grid) -> Vec<f32> {
        let transpose = ConvTranspose::pack(Level::detect(), self.shape, weight);
        let layout = transpose.layout(from.frames, from.size, to.size);
        let gradient = with_border(gradient, to, &layout);
        let mut dx = vec![0.0; from.len()];
        transpose.apply((&gradient, &layout), (&mut dx, from), false);
        dx
    }
}

impl CustomOp2 for ConvOp {
    fn name(&self) -> &'static str {
        "channels-last convolution"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        self.forward((x, x_layout), (weight, weight_layout), None)
    }

    fn bwd(
        &self,
        x: &Tensor,
        weight: &Tensor,
        _: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        with_values(gradient, |gradient| self.backward(x, weight, gradient))
    }
}

impl CustomOp3 for ConvOp {
    fn name(&self) -> &'static str {
        "channels-last convolution with bias"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
        bias: &CpuStorage,
        bias_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let bias = values(bias, bias_layout)?;
        self.forward((x, x_layout), (weight, weight_layout), Some(bias))
    }

    fn bwd(
        &self,
        x: &Tensor,
        weight: &Tensor,
        bias: &Tensor,
        y: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let masked = with_values(gradient, |gradient| {
            let mut gradient = gradient.to_vec();
            if self.relu {
                with_values(y, |y| {
                    for (gradient, y) in gradient.iter_mut().zip(y) {
                        *gradient = if *y > 0.0 { *gradient } else { 0.0 };
                    }
                    Ok(())
                })?;
            }
            Ok(gradient)
        })?;
        let mut db = vec![0.0_f64; self.shape.outputs];
        for pixel in masked.chunks_exact(self.shape.outputs) {
            for (db, gradient) in db.iter_mut().zip(pixel) {
                *db += f64::from(*gradient);
            }
        }
        let db: Vec<f32> = db.into_iter().map(|db| db as f32).collect();
        let db = Tensor::from_vec(db, bias.dims(), bias.device())?;
        let (dx, dw) = self.backward(x, weight, &masked)?;
        Ok((dx, dw, Some(db)))
    }
}
