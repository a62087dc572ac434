//! What batch norm does to each channel in training, by the statistics of its batch or by running ones, and what its
//! gradients come from; [`super::pointwise`] does it.
//!
//! `y = (x - mean) * factor + beta` with `factor = gamma / sqrt(variance + eps)`: the mean is
//! taken off first, so that a large common offset costs no digits.

use std::ops::Range;

use sps_base::parallel;

use super::bands::chunks;
use super::grid::Grid;
use super::statistics::{ChannelStatistics, run_rows};
use super::words::Real;

/// What batch norm does to each channel of one batch.
#[derive(Debug, Clone)]
pub(crate) struct Norm {
    /// Numbers of a channel that mean and variance are of; none where they do not depend on the batch.
    count: Option<usize>,
    pub(crate) mean: Vec<f32>,
    /// `1 / sqrt(variance + eps)`
    pub(crate) inverse: Vec<f32>,
    pub(crate) factor: Vec<f32>,
    pub(crate) beta: Vec<f32>,
}

impl Norm {
    /// By the statistics of the batch.
    pub(crate) fn new(moments: &ChannelStatistics, gamma: &[f32], beta: &[f32], eps: f64) -> Self {
        let given = Self::given([&moments.mean, &moments.variance, gamma, beta], eps);
        // What the mean's rounding lost: much of a spread that is small beside the mean.
        let lost = moments.mean_lost.iter().zip(&given.factor);
        let lost = lost.map(|(lost, &factor)| lost * f64::from(factor));
        let beta = beta.iter().zip(lost);
        Self {
            count: Some(moments.count),
            beta: beta
                .map(|(&b, lost)| (f64::from(b) - lost) as f32)
                .collect(),
            ..given
        }
    }

    /// By the given mean and variance, with gamma and beta.
    pub(crate) fn given([mean, variance, gamma, beta]: [&[f32]; 4], eps: f64) -> Self {
        let inverse = |&variance: &f32| (1.0 / (f64::from(variance) + eps).sqrt()) as f32;
        let inverse: Vec<f32> = variance.iter().map(inverse).collect();
        Self {
            count: None,
            mean: mean.to_vec(),
            factor: gamma.iter().zip(&inverse).map(|(g, i)| g * i).collect(),
            inverse,
            beta: beta.to_vec(),
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
    /// Adds up, frame by frame, what `run` says of each range of elements. It may change that range of `values`, where
    /// there are some.
    pub(crate) fn of<W: Real>(
        grid: &Grid,
        values: &mut [W],
        run: impl Fn(Range<usize>, &mut [W]) -> [Vec<f32>; 2] + Send + Sync,
    ) -> Self {
        let (frame_len, step) = (grid.frame_len(), run_rows(grid.channels) * grid.pitch);
        let frames = chunks(0..grid.len(), frame_len);
        let ranges: Vec<_> = frames.flat_map(|frame| chunks(frame, step)).collect();
        let frames = values.chunks_exact_mut(frame_len);
        let mut parts = frames.flat_map(|frame| frame.chunks_mut(step));
        let parts = ranges
            .iter()
            .map(|range| (range, parts.next().unwrap_or_default()));
        let runs = parallel::map(parts, |(range, part)| run(range.clone(), part));
        let mut sums = [0; 2].map(|_| vec![0.0; grid.frames * grid.channels]);
        for (range, run) in ranges.iter().zip(runs) {
            let first = range.start / frame_len * grid.channels;
            for (sums, run) in sums.iter_mut().zip(run) {
                for (sum, x) in sums[first..].iter_mut().zip(run) {
                    *sum += f64::from(x);
                }
            }
        }
        let [gradient, product] = sums;
        Self { gradient, product }
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
    /// From the sums over all numbers of each channel: of the gradient of `y`, and of that times `x - mean`.
    pub(crate) fn new(norm: &Norm, [gradient, product]: &[Vec<f64>; 2]) -> Self {
        // What does not depend on the batch passes nothing on.
        let count = norm.count.map_or(f64::INFINITY, |count| count as f64);
        let of = |number: &dyn Fn(usize) -> f64| -> Vec<f32> {
            (0..norm.mean.len()).map(|c| number(c) as f32).collect()
        };
        let inverse = |c: usize| f64::from(norm.inverse[c]);
        let factor = |c: usize| f64::from(norm.factor[c]);
        let gamma = |c: usize| product[c] * inverse(c);
        Self {
            gamma: of(&gamma),
            beta: of(&|c| gradient[c]),
            slopes: Slopes {
                of_gradient: norm.factor.clone(),
                of_x: of(&|c| -factor(c) * inverse(c) * gamma(c) / count),
                constant: of(&|c| -factor(c) * gradient[c] / count),
            },
        }
    }
}
