//! Every operator against a reference in f64 that is written straight from its definition, and
//! every gradient against central differences of that reference; on each level of vectors.

mod activated;
mod bf16;
mod bytes;
mod conv;
mod depthwise;
mod golden3d;
mod hard_cases;
mod image;
mod others;
mod split;
mod threads;
pub(super) mod tiles;
mod windows;
mod winograd;

use super::bands::Threads;
use super::conv::{Conv, ConvShape};
use super::grid::{Grid, Window};
use super::mean::frame_means;
use super::pool::max_pool;
use super::product::Epilogue;
use super::simd::Level;
use super::words::Word;

/// A function of several flat arrays, in f64.
type Reference<'a> = &'a dyn Fn(&[Vec<f64>]) -> Vec<f64>;

/// An operator: from its inputs and the gradient of its output to its output and its inputs' gradients.
type Operator<'a> = &'a dyn Fn(&[Vec<f32>], &[f32]) -> (Vec<f32>, Vec<Vec<f32>>);

const fn shape(window: Window, inputs: usize, outputs: usize, groups: usize) -> ConvShape {
    ConvShape {
        window,
        inputs,
        outputs,
        groups,
    }
}

/// Uniform in -1..1, the same for the same seed.
fn noise(len: usize, seed: u64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    (0..len)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            // Few digits: the same number in f32.
            ((state >> 44) as f64) / f64::from(1 << 19) - 1.0
        })
        .collect()
}

/// Works in a pool of so many threads.
pub(crate) fn by<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().unwrap().install(work)
}

fn narrow(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&value| value as f32).collect()
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().copied().map(f64::from).collect()
}

/// A map in memory of such a layout, rounded to what words hold; around it lies `border`.
fn laid_out<W: Word>(values: &[f64], grid: &Grid, border: f64) -> Vec<W> {
    let mut memory = vec![W::of(|_| border as f32); grid.len()];
    for (place, pixel) in grid.places().into_iter().zip(values.chunks(grid.channels)) {
        for (word, numbers) in memory[place..].iter_mut().zip(pixel.chunks(W::NUMBERS)) {
            *word = W::of(|i| numbers[i] as f32);
        }
    }
    memory
}

/// The numbers of a map without its border.
pub(crate) fn inside<W: Word>(memory: &[W], grid: &Grid) -> Vec<f64> {
    let pixel = |place: usize| W::numbers(&memory[place..][..grid.words]).map(f64::from);
    grid.places().into_iter().flat_map(pixel).collect()
}

/// What a convolution writes onto what is there. Around its source lies `border`.
fn convolved<W: Word>(
    (conv, threads): (&Conv<W>, Threads),
    (values, from, border): (&[f64], &Grid, f64),
    (before, to): (&[f64], &Grid),
    epilogue: Epilogue<'_>,
) -> Vec<f64> {
    let source = laid_out(values, from, border);
    let mut target = laid_out(before, to, 0.0);
    conv.apply(threads, (&source, from), (&mut target, to), epilogue);
    inside(&target, to)
}

/// The largest of `(1, 7, 6, 32)` numbers under each window, exactly, and their means.
fn check_pooling_and_means<W: Word>(values: &[f64], is_mean: fn(f32, f64) -> bool) {
    let window = Window::square(3, 2, 0);
    let grid = Grid::tight(1, [1, 7, 6], 32).of::<W>();
    let to = Grid {
        size: window.output_ceil(grid.size),
        ..grid
    };
    let source = laid_out::<W>(values, &grid, 0.0);
    Level::on_each(|level| {
        let mut target = vec![W::default(); to.len()];
        let pair = ((&source[..], &grid), (&mut target[..], &to));
        max_pool(Threads::One, level, &window, pair.0, pair.1);
        for (i, found) in inside(&target, &to).into_iter().enumerate() {
            let (pixel, channel) = (i / 32, i % 32);
            let (y, x) = (pixel / to.size[2] * 2, pixel % to.size[2] * 2);
            let under = (y..(y + 3).min(7)).flat_map(|y| (x..(x + 3).min(6)).map(move |x| (y, x)));
            let largest = under.map(|(y, x)| values[(y * 6 + x) * 32 + channel]);
            assert_eq!(found, largest.fold(f64::NEG_INFINITY, f64::max));
        }
        let mut means = [0.0; 32];
        frame_means(Threads::One, level, &source, &grid, &mut [&mut means]);
        for (channel, &mean) in means.iter().enumerate() {
            let sum: f64 = values.iter().skip(channel).step_by(32).sum();
            assert!(is_mean(mean, sum / 42.0));
        }
    });
}

/// The layout of `(frames, [time,] height, width, channels)`; rows of all times are one above the
/// other.
fn grid(dims: &[usize]) -> Grid {
    let [frames, between @ .., width, channels] = dims else {
        panic!("{dims:?}");
    };
    Grid::tight(*frames, [1, between.iter().product(), *width], *channels)
}

/// The largest difference, relative to the largest number expected.
fn distance(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let scale = expected.iter().fold(1e-3_f64, |m, e| m.max(e.abs()));
    let pairs = found.iter().zip(expected);
    pairs.fold(0.0, |m: f64, (f, e)| m.max((f - e).abs())) / scale
}

/// The gradient of `sum(reference * cotangent)` by central differences.
fn central_differences(
    reference: Reference<'_>,
    inputs: &[Vec<f64>],
    cotangent: &[f64],
) -> Vec<Vec<f64>> {
    const STEP: f64 = 1e-5;
    let loss = |inputs: &[Vec<f64>]| -> f64 {
        let y = reference(inputs);
        y.iter().zip(cotangent).map(|(y, c)| y * c).sum()
    };
    let mut inputs = inputs.to_vec();
    (0..inputs.len())
        .map(|which| {
            (0..inputs[which].len())
                .map(|i| {
                    let value = inputs[which][i];
                    inputs[which][i] = value + STEP;
                    let above = loss(&inputs);
                    inputs[which][i] = value - STEP;
                    let below = loss(&inputs);
                    inputs[which][i] = value;
                    (above - below) / (2.0 * STEP)
                })
                .collect()
        })
        .collect()
}

/// Holds an operator to its reference: outputs within 3e-6, gradients within 2e-5 of their
/// largest element (f32 sums against f64), on each level.
fn check(case: &str, inputs: &[Vec<f64>], operator: Operator<'_>, reference: Reference<'_>) {
    let expected = reference(inputs);
    let cotangent = noise(expected.len(), 99);
    let expected_gradients = central_differences(reference, inputs, &cotangent);
    let inputs: Vec<Vec<f32>> = inputs.iter().map(|input| narrow(input)).collect();
    Level::on_each(|level| {
        let (y, gradients) = operator(&inputs, &narrow(&cotangent));
        let error = distance(&wide(&y), &expected);
        assert!(error < 3e-6, "{case}, {level:?}: output off by {error:.1e}");
        assert_eq!(gradients.len(), expected_gradients.len());
        for (i, (found, expected)) in gradients.iter().zip(&expected_gradients).enumerate() {
            let error = distance(&wide(found), expected);
            assert!(
                error < 2e-5,
                "{case}, {level:?}: gradient {i} off by {error:.1e}"
            );
        }
    });
}
