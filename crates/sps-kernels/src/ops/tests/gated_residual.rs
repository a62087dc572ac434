//! The end of a residual branch, forward and backward.

use super::grid;
use crate::ops::batch_norm::Norm;
use crate::ops::product::Activation;
use crate::ops::residual::{Branch, FrameSlopes, Shortcut};
use crate::ops::simd::Level;

/// `relu(x * gate + shortcut)` of feature maps `(frames, [time,] height, width, channels)` and a gate
/// `(frames, channels)`, and their gradients.
pub(super) fn gated_residual(
    dims: &[usize],
    inputs: &[Vec<f32>],
    gradient: &[f32],
) -> (Vec<f32>, Vec<Vec<f32>>) {
    let [x, gate, shortcut] = inputs else {
        unreachable!()
    };
    let (grid, level) = (grid(dims), Level::detect());
    let norm = identity(grid.channels);
    let branch = Branch {
        x,
        norm: &norm,
        gate,
        grid: &grid,
        activation: Activation::Relu,
    };
    let mut y = vec![0.0; grid.len()];
    branch.end(level, Shortcut::Plain(shortcut, &grid), (&mut y, &grid));
    let mut masked = gradient.to_vec();
    let sums = branch.mask(level, (&y, &grid), &mut masked);
    let slopes = FrameSlopes {
        of_gradient: gate.clone(),
        of_x: vec![0.0; grid.channels],
        constant: vec![0.0; grid.frames * grid.channels],
    };
    let mut of_x = vec![0.0; grid.len()];
    branch.backward(level, &slopes, &masked, (&mut of_x, &grid));
    let of_gate = sums.product.iter().map(|&sum| sum as f32).collect();
    (y, vec![of_x, of_gate, masked])
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
