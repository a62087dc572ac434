use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor, bail};

use super::{grid, values, with_values};
use crate::error::Error;
use crate::ops::batch_norm::Norm;
use crate::ops::grid::Grid;
use crate::ops::residual::{Branch, FrameSlopes, Shortcut};
use crate::ops::simd::Level;

/// `relu(x * gate + shortcut)`: the end of a squeeze-and-excitation block.
///
/// `x` and `shortcut` are `(frames, [time,] height, width, channels)`, `gate` is
/// `(frames, channels)`. Differentiable in all three.
///
/// # Errors
///
/// When the shapes do not fit each other, or a tensor is not f32 on the CPU.
pub fn gated_residual(
    x: &Tensor,
    gate: &Tensor,
    shortcut: &Tensor,
) -> crate::error::Result<Tensor> {
    let fits = |grid: Grid| gate.dims() == [grid.frames, grid.channels] && grid.len() > 0;
    if x.dims() != shortcut.dims() || !grid(x.dims()).is_some_and(fits) {
        return Err(Error::input(
            "gated residual",
            format!(
                "x {:?}, gate {:?}, shortcut {:?}",
                x.dims(),
                gate.dims(),
                shortcut.dims()
            ),
            "x and shortcut (frames, [time,] height, width, channels), gate (frames, channels)",
        ));
    }
    let (gate, shortcut) = (gate.contiguous()?, shortcut.contiguous()?);
    Ok(x.contiguous()?.apply_op3(&gate, &shortcut, GatedResidual)?)
}

struct GatedResidual;

/// A norm that changes nothing.
fn identity(channels: usize) -> Norm {
    Norm {
        mean: vec![0.0; channels],
        inverse: vec![1.0; channels],
        factor: vec![1.0; channels],
        beta: vec![0.0; channels],
    }
}

impl CustomOp3 for GatedResidual {
    fn name(&self) -> &'static str {
        "gated residual"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        gate: &CpuStorage,
        gate_layout: &Layout,
        shortcut: &CpuStorage,
        shortcut_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let Some(grid) = grid(x_layout.dims()) else {
            bail!("gated residual of {:?}", x_layout.dims())
        };
        let branch = Branch {
            x: values(x, x_layout)?,
            norm: &identity(grid.channels),
            gate: values(gate, gate_layout)?,
            grid: &grid,
        };
        let mut y = vec![0.0; grid.len()];
        let shortcut = values(shortcut, shortcut_layout)?;
        branch.end(Level::detect(), Shortcut::Plain(shortcut), &mut y);
        Ok((CpuStorage::F32(y), x_layout.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        gate: &Tensor,
        shortcut: &Tensor,
        y: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let Some(grid) = grid(x.dims()) else {
            bail!("gated residual of {:?}", x.dims())
        };
        let level = Level::detect();
        let mut masked = with_values(gradient, |gradient| Ok(gradient.to_vec()))?;
        let mut dx = vec![0.0; grid.len()];
        let gates = with_values(gate, |gate| Ok(gate.to_vec()))?;
        let sums = with_values(x, |x| {
            let branch = Branch {
                x,
                norm: &identity(grid.channels),
                gate: &gates,
                grid: &grid,
            };
            let sums = with_values(y, |y| Ok(branch.mask(level, y, &mut masked)))?;
            let slopes = FrameSlopes {
                of_gradient: gates.clone(),
                of_x: vec![0.0; grid.channels],
                constant: vec![0.0; grid.frames * grid.channels],
            };
            branch.backward(level, &slopes, &masked, &mut dx);
            Ok(sums)
        })?;
        let device = x.device();
        let dgate: Vec<f32> = sums.product.iter().map(|&sum| sum as f32).collect();
        Ok((
            Some(Tensor::from_vec(dx, x.dims(), device)?),
            Some(Tensor::from_vec(dgate, gate.dims(), device)?),
            Some(Tensor::from_vec(masked, shortcut.dims(), device)?),
        ))
    }
}
