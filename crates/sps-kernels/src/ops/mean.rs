//! The mean of a feature map over space.

use super::bands::{Threads, on_all_threads};
use super::grid::Grid;
use super::simd::{Kernel, Lanes, Level};
use super::words::Word;

/// Pixels whose sum is taken in f32 before it joins a longer one.
const RUN: usize = 64;

/// Words that are summed sooner than another thread is called for help.
const FEW: usize = 64 << 10;

/// Writes into each frame's slice the mean of each channel over the frame's pixels.
///
/// The order of the sums is that of the pixels, whatever the threads.
pub(crate) fn frame_means<W: Word>(
    threads: Threads,
    level: Level,
    source: &[W],
    grid: &Grid,
    means: &mut [&mut [f32]],
) {
    let places = Grid { frames: 1, ..*grid }.places();
    let runs: Vec<&[usize]> = places.chunks(RUN).collect();
    for (frame, means) in source.chunks_exact(grid.frame_len()).zip(means) {
        let mut sums: Vec<Vec<f32>> = vec![Vec::new(); runs.len()];
        let sum = |(run, sum): (&&[usize], &mut Vec<f32>)| {
            *sum = level.run(Sum { frame, run, grid });
        };
        let each = runs.iter().zip(&mut sums);
        match threads {
            Threads::All if frame.len() > FEW => on_all_threads(each.collect(), sum),
            _ => each.for_each(sum),
        }
        let pixels = places.len() as f64;
        for (channel, mean) in means.iter_mut().enumerate() {
            let sum: f64 = sums.iter().map(|run| f64::from(run[channel])).sum();
            *mean = (sum / pixels) as f32;
        }
    }
}

/// The sum over the pixels of a run.
struct Sum<'a, W> {
    frame: &'a [W],
    run: &'a [usize],
    grid: &'a Grid,
}

impl<W: Word> Kernel for Sum<'_, W> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) -> Vec<f32> {
        let mut sums = vec![0.0; self.grid.channels];
        for &place in self.run {
            let pixel = &self.frame[place..place + self.grid.words];
            for (sum, x) in sums.iter_mut().zip(W::numbers(pixel)) {
                *sum += x;
            }
        }
        sums
    }
}
