//! The mean of a feature map over space.

use half::bf16;
use rayon::prelude::*;

use super::bands::Threads;
use super::format::Format;
use super::grid::Grid;
use super::simd::{Kernel, Lanes, Level};

/// Pixels whose sum is taken in f32 before it joins a longer one.
const RUN: usize = 64;

/// Words that are summed sooner than another thread is called for help.
const FEW: usize = 64 << 10;

/// Writes `(frames, channels)`, the mean of each channel over a frame's pixels.
///
/// `grid` has no border. The order of the sums is that of the pixels, whatever the threads.
pub(crate) fn frame_means(
    threads: Threads,
    level: Level,
    source: &[f32],
    grid: &Grid,
    means: &mut [f32],
) {
    let channels = grid.channels;
    let frames = source
        .chunks_exact(grid.frame_len())
        .zip(means.chunks_exact_mut(channels));
    for (frame, means) in frames {
        let runs: Vec<&[f32]> = frame.chunks(RUN * grid.pitch).collect();
        let sum = |run: &&[f32]| level.run(Sum { run, grid });
        let sums: Vec<Vec<f32>> = match threads {
            Threads::All if frame.len() > FEW => runs.par_iter().map(sum).collect(),
            _ => runs.iter().map(sum).collect(),
        };
        let pixels = (frame.len() / grid.pitch) as f64;
        for (channel, mean) in means.iter_mut().enumerate() {
            let sum: f64 = sums.iter().map(|run| f64::from(run[channel])).sum();
            *mean = (sum / pixels) as f32;
        }
    }
}

/// The sum over the pixels of a run.
struct Sum<'a> {
    run: &'a [f32],
    grid: &'a Grid,
}

impl Kernel for Sum<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) -> Vec<f32> {
        let mut sums = vec![0.0; self.grid.channels];
        for pixel in self.run.chunks_exact(self.grid.pitch) {
            match self.grid.format {
                Format::F32 => {
                    for (sum, x) in sums.iter_mut().zip(pixel) {
                        *sum += x;
                    }
                }
                Format::Bf16 => {
                    let pixel: &[bf16] = bytemuck::cast_slice(pixel);
                    for (sum, x) in sums.iter_mut().zip(pixel) {
                        *sum += widened(*x);
                    }
                }
            }
        }
        sums
    }
}

/// The same number; as plain bits, so that the loop becomes one over vectors.
#[inline(always)]
pub(super) fn widened(x: bf16) -> f32 {
    f32::from_bits(u32::from(x.to_bits()) << 16)
}
