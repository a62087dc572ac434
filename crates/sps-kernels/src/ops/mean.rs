//! The mean of a feature map over space.

use super::bands::{Threads, on_all_threads};
use super::grid::Grid;
use super::simd::Level;
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
        let sum = |(&run, sums): (&&[usize], &mut Vec<f32>)| {
            *sums = level.run(
                #[inline(always)]
                move || {
                    let mut sums = vec![0.0; grid.channels];
                    for &place in run {
                        let pixel = &frame[place..place + grid.words];
                        for (sum, x) in sums.iter_mut().zip(W::numbers(pixel)) {
                            *sum += x;
                        }
                    }
                    sums
                },
            );
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
