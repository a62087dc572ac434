//! What batch norm in training does to each channel, and what its gradients come from; [`super::pointwise`] does it.
//!
//! `y = (x - mean) * factor + beta` with `factor = gamma / sqrt(variance + eps)`: the mean is
//! taken off first, so that a large common offset costs no digits.

use std::ops::Range;

use rayon::prelude::*;

use super::grid::Grid;
use super::statistics::{ChannelStatistics, run_rows};
use super::words::Real;

/// What batch norm does to each channel of one batch.
#[derive(Debug, Clone)]
pub(crate) struct Norm {
    pub(crate) mean: Vec<f32>,
    /// `1 / sqrt(variance + eps)`
    pub(crate) inverse: Vec<f32>,
    pub(crate) factor: Vec<f32>,
    pub(crate) beta: Vec<f32>,
}

impl Norm {
    pub(crate) fn new(moments: &ChannelStatistics, gamma: &[f32], beta: &[f32], eps: f64) -> Self {
        let inverse: Vec<f32> = moments
            .variance
            .iter()
            .map(|&variance| (1.0 / (f64::from(variance) + eps).sqrt()) as f32)
            .collect();
        let factor: Vec<f32> = gamma.iter().zip(&inverse).map(|(g, i)| g * i).collect();
        let lost = moments.mean_lost.iter().zip(&factor);
        Self {
            mean: moments.mean.clone(),
            // What the mean's rounding lost: much of a spread that is small beside the mean.
            beta: beta
                .iter()
                .zip(lost)
                .map(|(&beta, (lost, &factor))| (f64::from(beta) - lost * f64::from(factor)) as f32)
                .collect(),
            inverse,
            factor,
        }
    }

    /// The number of channels; mean, factor and beta of each, slices that the compiler knows to
    /// be of one length: otherwise it would check every index, one channel at a time.
    #[inline(always)]
    pub(super) fn channels(&self) -> (usize, &[f32], &[f32], &[f32]) {
        let n = self.mean.len();
        (n, &self.mean[..n], &self.factor[..n], &self.beta[..n])
    }
}

/// For each frame and channel, the sum of the gradient, and of the gradient times `x - mean`.
#[derive(Debug, Clone)]
pub(crate) struct FrameSums {
    /// `(frames, channels)`
    pub(crate) gradient: Vec<f64>,
    /// `(frames, channels)`
    pub(crate) product: Vec<f64>,
}

impl FrameSums {
    /// Adds up, frame by frame, what `run` says of each range of elements.
    pub(crate) fn of(
        grid: &Grid,
        run: impl Fn(Range<usize>) -> [Vec<f32>; 2] + Send + Sync,
    ) -> Self {
        let ranges = runs(grid);
        let sums: Vec<_> = ranges.par_iter().map(|range| run(range.clone())).collect();
        Self::join(grid, &ranges, &sums)
    }

    /// The same where `run` also changes that range of `values`.
    pub(crate) fn of_mut<W: Real>(
        grid: &Grid,
        values: &mut [W],
        run: impl Fn(Range<usize>, &mut [W]) -> [Vec<f32>; 2] + Send + Sync,
    ) -> Self {
        let ranges = runs(grid);
        let mut rest = values;
        let mut parts = Vec::with_capacity(ranges.len());
        for range in &ranges {
            let (part, tail) = rest.split_at_mut(range.len());
            parts.push((range.clone(), part));
            rest = tail;
        }
        let parts = parts.into_par_iter();
        let sums: Vec<_> = parts.map(|(range, part)| run(range, part)).collect();
        Self::join(grid, &ranges, &sums)
    }

    fn join(grid: &Grid, ranges: &[Range<usize>], runs: &[[Vec<f32>; 2]]) -> Self {
        let channels = grid.channels;
        let mut sums = Self {
            gradient: vec![0.0; grid.frames * channels],
            product: vec![0.0; grid.frames * channels],
        };
        for (range, [gradient, product]) in ranges.iter().zip(runs) {
            let frame = range.start / grid.frame_len();
            let of_frame = frame * channels..(frame + 1) * channels;
            add(&mut sums.gradient[of_frame.clone()], gradient);
            add(&mut sums.product[of_frame], product);
        }
        sums
    }

    /// The sums over all frames, `(channels)` each: gradient, and gradient times `x - mean`.
    pub(crate) fn over_frames(&self, channels: usize) -> [Vec<f64>; 2] {
        [&self.gradient, &self.product].map(|sums| {
            let mut total = vec![0.0; channels];
            for frame in sums.chunks_exact(channels) {
                for (total, sum) in total.iter_mut().zip(frame) {
                    *total += sum;
                }
            }
            total
        })
    }
}

/// Cuts a feature map into runs; none reaches over two frames.
fn runs(grid: &Grid) -> Vec<Range<usize>> {
    let (frame_len, step) = (grid.frame_len(), run_rows(grid.channels) * grid.pitch);
    (0..grid.frames)
        .flat_map(|frame| {
            let (start, end) = (frame * frame_len, (frame + 1) * frame_len);
            (start..end)
                .step_by(step)
                .map(move |from| from..(from + step).min(end))
        })
        .collect()
}

fn add(sums: &mut [f64], run: &[f32]) {
    for (sum, x) in sums.iter_mut().zip(run) {
        *sum += f64::from(*x);
    }
}

/// The gradient of `x` as an affine function: `gradient * of_gradient + (x - mean) * of_x +
/// constant`. All `(channels)`, or `(frames, channels)` but for that of `x`.
#[derive(Debug, Clone)]
pub(crate) struct Slopes {
    pub(crate) of_gradient: Vec<f32>,
    pub(crate) of_x: Vec<f32>,
    pub(crate) constant: Vec<f32>,
}

/// The gradients of batch norm's own parameters, and what gives that of its input.
#[derive(Debug, Clone)]
pub(crate) struct NormGradients {
    pub(crate) gamma: Vec<f32>,
    pub(crate) beta: Vec<f32>,
    pub(crate) slopes: Slopes,
}

impl NormGradients {
    /// From the sums over all `count` numbers of each channel: of the gradient of `y`, and of
    /// that times `x - mean`.
    pub(crate) fn new(norm: &Norm, count: usize, [gradient, product]: &[Vec<f64>; 2]) -> Self {
        let count = count as f64;
        let channels = norm.mean.len();
        let mut all = Self {
            gamma: Vec::with_capacity(channels),
            beta: Vec::with_capacity(channels),
            slopes: Slopes {
                of_gradient: norm.factor.clone(),
                of_x: Vec::with_capacity(channels),
                constant: Vec::with_capacity(channels),
            },
        };
        for channel in 0..channels {
            let inverse = f64::from(norm.inverse[channel]);
            let factor = f64::from(norm.factor[channel]);
            let gamma = product[channel] * inverse;
            all.gamma.push(gamma as f32);
            all.beta.push(gradient[channel] as f32);
            all.slopes
                .of_x
                .push((-factor * inverse * gamma / count) as f32);
            all.slopes
                .constant
                .push((-factor * gradient[channel] / count) as f32);
        }
        all
    }
}
