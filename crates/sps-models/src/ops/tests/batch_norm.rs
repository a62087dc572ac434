//! Batch norm's kernels as an operator of candle.

use candle_core::Tensor;

use super::grid;
use crate::ops::batch_norm::{Norm, NormGradients};
use crate::ops::product::Activation;
use crate::ops::simd::Level;
use crate::ops::statistics::ChannelStatistics;
use crate::ops::{differentiable, with_values};

/// A feature map `(frames, [time,] height, width, channels)` by the batch's own statistics, and these;
/// rectified where `relu` says so.
pub(super) fn batch_norm(
    [x, gamma, beta]: [&Tensor; 3],
    eps: f64,
    relu: bool,
) -> (Tensor, ChannelStatistics) {
    let grid = grid(x);
    let level = Level::detect();
    let activation = if relu {
        Activation::Relu
    } else {
        Activation::Identity
    };
    let mut y = vec![0.0; grid.len()];
    let (statistics, norm) = with_values(x, |x| {
        let statistics = ChannelStatistics::of(level, x, &grid);
        let norm = with_values(gamma, |gamma| {
            with_values(beta, |beta| Ok(Norm::new(&statistics, gamma, beta, eps)))
        })?;
        norm.apply(level, (x, &grid), (&mut y, &grid), activation);
        Ok((statistics, norm))
    })
    .unwrap();
    let (input, count) = (x.clone(), statistics.count);
    let backward = move |_: &[f32], gradient: &[f32]| {
        with_values(&input, |x| {
            let sums = norm.sums(level, x, gradient, &grid, activation);
            let sums = sums.over_frames(grid.channels);
            let gradients = NormGradients::new(&norm, count, &sums);
            let mut dx = vec![0.0; grid.len()];
            let target = (&mut dx[..], &grid);
            norm.backward(level, &gradients.slopes, x, gradient, target, activation);
            Ok([Some(dx), Some(gradients.gamma), Some(gradients.beta)])
        })
    };
    let output = differentiable([x, gamma, beta], y, x.shape(), backward).unwrap();
    (output, statistics)
}
