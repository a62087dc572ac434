//! Batch norm's kernels, forward and backward.

use super::grid;
use crate::ops::batch_norm::{Norm, NormGradients};
use crate::ops::product::Activation;
use crate::ops::simd::Level;
use crate::ops::statistics::ChannelStatistics;

/// A feature map `(frames, [time,] height, width, channels)` by the batch's own statistics, rectified where `relu`
/// says so; the gradients of map, gamma and beta; the statistics.
pub(super) fn batch_norm(
    dims: &[usize],
    inputs: &[Vec<f32>],
    eps: f64,
    relu: bool,
    gradient: &[f32],
) -> (Vec<f32>, Vec<Vec<f32>>, ChannelStatistics) {
    let [x, gamma, beta] = inputs else {
        unreachable!()
    };
    let (grid, level) = (grid(dims), Level::detect());
    let activation = if relu {
        Activation::Relu
    } else {
        Activation::Identity
    };
    let statistics = ChannelStatistics::of(level, x, &grid);
    let norm = Norm::new(&statistics, gamma, beta, eps);
    let mut y = vec![0.0; grid.len()];
    norm.apply(level, (x, &grid), (&mut y, &grid), activation);
    let sums = norm.sums(level, x, gradient, &grid, activation);
    let gradients = NormGradients::new(&norm, statistics.count, &sums.over_frames(grid.channels));
    let mut of_x = vec![0.0; grid.len()];
    let target = (&mut of_x[..], &grid);
    norm.backward(level, &gradients.slopes, x, gradient, target, activation);
    (y, vec![of_x, gradients.gamma, gradients.beta], statistics)
}
