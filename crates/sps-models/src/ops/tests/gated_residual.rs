//! The end of a residual branch as an operator of candle.

use candle_core::Tensor;

use super::grid;
use crate::ops::batch_norm::Norm;
use crate::ops::product::Activation;
use crate::ops::residual::{Branch, FrameSlopes, Shortcut};
use crate::ops::simd::Level;
use crate::ops::{differentiable, with_values};

/// `relu(x * gate + shortcut)` of feature maps `(frames, [time,] height, width, channels)` and a gate
/// `(frames, channels)`.
pub(super) fn gated_residual(x: &Tensor, gate: &Tensor, shortcut: &Tensor) -> Tensor {
    let grid = grid(x);
    let level = Level::detect();
    let norm = identity(grid.channels);
    let gate_values = with_values(gate, |gate| Ok(gate.to_vec())).unwrap();
    let mut y = vec![0.0; grid.len()];
    with_values(x, |x| {
        with_values(shortcut, |shortcut| {
            let branch = Branch {
                x,
                norm: &norm,
                gate: &gate_values,
                grid: &grid,
                activation: Activation::Relu,
            };
            branch.end(level, Shortcut::Plain(shortcut, &grid), (&mut y, &grid));
            Ok(())
        })
    })
    .unwrap();
    let input = x.clone();
    let backward = move |y: &[f32], gradient: &[f32]| {
        let mut masked = gradient.to_vec();
        let mut dx = vec![0.0; grid.len()];
        let sums = with_values(&input, |x| {
            let branch = Branch {
                x,
                norm: &norm,
                gate: &gate_values,
                grid: &grid,
                activation: Activation::Relu,
            };
            let sums = branch.mask(level, (y, &grid), &mut masked);
            let slopes = FrameSlopes {
                of_gradient: gate_values.clone(),
                of_x: vec![0.0; grid.channels],
                constant: vec![0.0; grid.frames * grid.channels],
            };
            branch.backward(level, &slopes, &masked, (&mut dx, &grid));
            Ok(sums)
        })?;
        let dgate = sums.product.iter().map(|&sum| sum as f32).collect();
        Ok([Some(dx), Some(dgate), Some(masked)])
    };
    differentiable([x, gate, shortcut], y, x.shape(), backward).unwrap()
}

/// A norm that changes nothing.
fn identity(channels: usize) -> Norm {
    Norm {
        mean: vec![0.0; channels],
        inverse: vec![1.0; channels],
        factor: vec![1.0; channels],
        beta: vec![0.0; channels],
    }
}
