//! Mean and variance of each channel of a feature map.

use sps_base::parallel;

use super::grid::{Grid, rows};
use super::simd::Level;
use super::words::Word;

/// Elements of a run, whose sums are taken in f32: a run is read twice and stays in the cache.
const RUN: usize = 32 << 10;

/// Mean and variance over frames and space, and the mean over space of each frame.
#[derive(Debug, Clone)]
pub(crate) struct ChannelStatistics {
    /// Numbers in one channel.
    pub(crate) count: usize,
    /// `(channels)`
    pub(crate) mean: Vec<f32>,
    /// What rounding took from the mean, `(channels)`.
    pub(crate) mean_lost: Vec<f64>,
    /// `(channels)`, over `count`.
    pub(crate) variance: Vec<f32>,
    /// `(frames, channels)`
    pub(crate) frame_means: Vec<f32>,
}

/// Rows of a run: a function of the channels alone, so that no sum depends on the number of threads.
pub(super) fn run_rows(channels: usize) -> usize {
    (RUN / channels).max(1)
}

impl ChannelStatistics {
    /// Those of a feature map without a border.
    ///
    /// A run's deviations are taken from its own mean, and runs are joined in f64 (Chan et al.,
    /// 1979): a large common offset costs no digits.
    pub(crate) fn of<W: Word>(level: Level, source: &[W], grid: &Grid) -> Self {
        let (channels, pitch) = (grid.channels, grid.pitch);
        let step = run_rows(channels) * pitch;
        let frames = source.chunks_exact(grid.frame_len());
        let statistics = |run: &[W]| {
            level.run(
                #[inline(always)]
                move || PartialStatistics::of(run, channels, pitch),
            )
        };
        let runs = parallel::map(frames.flat_map(|frame| frame.chunks(step)), statistics);
        let mut all = PartialStatistics::empty(channels);
        let mut frame_means = Vec::with_capacity(grid.frames * channels);
        for frame in runs.chunks(grid.frame_len().div_ceil(step).max(1)) {
            let mut one = PartialStatistics::empty(channels);
            for run in frame {
                one.join(run);
            }
            frame_means.extend(one.mean.iter().map(|&mean| mean as f32));
            all.join(&one);
        }
        let narrow = |values: &[f64], by: f64| -> Vec<f32> {
            values.iter().map(|v| (v / by) as f32).collect()
        };
        let mean = narrow(&all.mean, 1.0);
        let exact = all.mean.iter().zip(&mean);
        Self {
            count: all.count,
            mean_lost: exact.map(|(m, &narrow)| m - f64::from(narrow)).collect(),
            mean,
            variance: narrow(&all.squares, all.count as f64),
            frame_means,
        }
    }
}

/// Count, mean and sum of squared deviations.
struct PartialStatistics {
    count: usize,
    mean: Vec<f64>,
    squares: Vec<f64>,
}

impl PartialStatistics {
    fn empty(channels: usize) -> Self {
        Self {
            count: 0,
            mean: vec![0.0; channels],
            squares: vec![0.0; channels],
        }
    }

    /// Of a run: of the channels of its pixels, which lie `pitch` words apart.
    #[inline(always)]
    fn of<W: Word>(run: &[W], channels: usize, pitch: usize) -> Self {
        let count = run.len() / pitch;
        let mut sum = vec![0.0_f32; channels];
        for row in rows(run, pitch, channels) {
            for (sum, &x) in sum.iter_mut().zip(row) {
                *sum += W::widened(x);
            }
        }
        let near: Vec<f32> = sum.iter().map(|sum| sum / count as f32).collect();
        // `near` is the mean but for rounding; what is left of the deviations corrects it.
        let mut left = vec![0.0_f32; channels];
        let mut squares = vec![0.0_f32; channels];
        for row in rows(run, pitch, channels) {
            let sums = left.iter_mut().zip(&mut squares);
            for ((&x, near), (left, squares)) in row.iter().zip(&near).zip(sums) {
                let deviation = W::widened(x) - near;
                *left += deviation;
                *squares += deviation * deviation;
            }
        }
        let n = count as f64;
        let corrected = left.iter().zip(&squares).map(|(&left, &squares)| {
            let left = f64::from(left);
            (left / n, (f64::from(squares) - left * left / n).max(0.0))
        });
        let (shift, squares): (Vec<f64>, Vec<f64>) = corrected.unzip();
        let mean = near.iter().zip(shift).map(|(&near, s)| f64::from(near) + s);
        Self {
            count,
            mean: mean.collect(),
            squares,
        }
    }

    fn join(&mut self, other: &Self) {
        let count = self.count + other.count;
        let weight = other.count as f64 / count as f64;
        let both = self.count as f64 * weight;
        let others = other.mean.iter().zip(&other.squares);
        for ((mean, squares), (m, s)) in self.mean.iter_mut().zip(&mut self.squares).zip(others) {
            let distance = m - *mean;
            *mean += distance * weight;
            *squares += s + distance * distance * both;
        }
        self.count = count;
    }
}
