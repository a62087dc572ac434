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
mod winograd;

use super::bands::Threads;
use super::conv::{Conv, ConvShape};
use super::conv_input::ConvTranspose;
use super::conv_weight::weight_gradient;
use super::grid::{Grid, Window, pixels};
use super::mean::frame_means;
use super::pool::max_pool;
use super::product::{Activation, Columns, Epilogue};
use super::simd::Level;
use super::words::{Bf16Pair, Bytes, Real, Word};
use conv::Case;

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
    let numbers = (0..len).map(|_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        // Few digits: the same number in f32.
        ((state >> 44) as f64) / f64::from(1 << 19) - 1.0
    });
    numbers.collect()
}

/// Whole numbers of `least` to `most`, both among them.
fn whole(len: usize, seed: u64, [least, most]: [f64; 2]) -> Vec<f64> {
    let (middle, reach) = (f64::midpoint(least, most), (most - least) / 2.0 + 0.5);
    let number = |x: f64| (middle + reach * x).round().clamp(least, most);
    noise(len, seed).into_iter().map(number).collect()
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

/// Numbers as words hold them.
fn rounded<W: Word>(values: &[f64]) -> Vec<f64> {
    let grid = Grid::tight(1, [1; 3], values.len()).of::<W>();
    let mut rounded = inside(&laid_out::<W>(values, &grid, 0.0), &grid);
    rounded.truncate(values.len());
    rounded
}

/// Holds a convolution, as it is in training and in inference, onto what is there and not, to its definition: numbers
/// may be off by `rounding` of themselves and by `slack`. The source has a border such as a window pads.
fn check_sums<W: Word>(
    (case, border): (&Case, &Window),
    weights: &[f64],
    activation: Activation,
    [rounding, slack]: [f64; 2],
) {
    let (shape, to) = (case.shape, case.to::<W>());
    let from = case.from::<W>().enclosing(border);
    let values = rounded::<W>(&noise(case.numbers(), 1));
    let sums = case.reference(&values, weights);
    let before = rounded::<W>(&noise(sums.len(), 4));
    let (weights, shift) = (narrow(weights), noise(shape.outputs, 3));
    let (shift_of, limits) = (narrow(&shift), activation.limits().map(f64::from));
    Level::on_each(|level| {
        let conv = Conv::<W>::pack(level, shape, &weights);
        let for_inference = Conv::pack_for_inference(level, shape, &weights);
        for (conv, accumulate) in [(&conv, false), (&conv, true), (&for_inference, true)] {
            let epilogue = Epilogue {
                accumulate: accumulate.then_some(1.0),
                ..Epilogue::biased(&shift_of, activation)
            };
            let (conv, source) = ((conv, Threads::One), (&values[..], &from, 0.0));
            let found = convolved(conv, source, (&before, &to), epilogue);
            assert_eq!(found.len(), sums.len());
            for (i, found) in found.into_iter().enumerate() {
                let stored = if accumulate { before[i] } else { 0.0 };
                let expected = sums[i] + shift[i % shape.outputs] + stored;
                let expected = expected.clamp(limits[0], limits[1]);
                let error = (found - expected).abs();
                let what = format!("{level:?} {shape:?} {:?} {i}", case.size);
                assert!(
                    error <= rounding * expected.abs() + slack,
                    "{what}: {found} for {expected}"
                );
            }
        }
    });
}

/// The gradients of a convolution's weights and of its input, the latter added to what is there. `map` makes maps of
/// a layout by a number.
fn gradients<W: Real>(
    level: Level,
    case: &Case,
    weights: &[f32],
    map: impl Fn(&Grid, u64) -> Vec<W>,
) -> [Vec<f64>; 2] {
    let (shape, to) = (case.shape, case.from::<W>());
    let transpose = ConvTranspose::<W>::pack(level, shape, weights);
    let layout = transpose.layout(case.frames, case.size, case.to::<W>().size);
    let from = to.padded(&shape.window);
    let (source, gradient) = (map(&from, 2), map(&layout, 3));
    let gradient = (&gradient[..], &layout);
    let mut of_weights = vec![0.0; weights.len()];
    weight_gradient(level, &shape, (&source, &from), gradient, &mut of_weights);
    let mut of_input = map(&to, 4);
    transpose.apply(gradient, (&mut of_input, &to), true);
    [wide(&of_weights), inside(&of_input, &to)]
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
    let largest = others::pool_reference(values, [1, 1, 7, 6, 32], &window, to.size);
    Level::on_each(|level| {
        let mut target = vec![W::default(); to.len()];
        let pair = ((&source[..], &grid), (&mut target[..], &to));
        max_pool(Threads::One, level, &window, pair.0, pair.1);
        assert_eq!(inside(&target, &to), largest);
        let mut means = [0.0; 32];
        frame_means(Threads::One, level, &source, &grid, &mut [&mut means]);
        for (channel, &mean) in means.iter().enumerate() {
            let sum: f64 = values.iter().skip(channel).step_by(32).sum();
            assert!(is_mean(mean, sum / 42.0));
        }
    });
}

/// The layout of `(frames, time, height, width, channels)`.
fn grid([frames, size @ .., channels]: [usize; 5]) -> Grid {
    Grid::tight(frames, size, channels)
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
    let (mut inputs, mut slopes) = (inputs.to_vec(), inputs.to_vec());
    for (which, slopes) in slopes.iter_mut().enumerate() {
        for (i, slope) in slopes.iter_mut().enumerate() {
            let value = inputs[which][i];
            inputs[which][i] = value + STEP;
            let above = loss(&inputs);
            inputs[which][i] = value - STEP;
            let below = loss(&inputs);
            inputs[which][i] = value;
            *slope = (above - below) / (2.0 * STEP);
        }
    }
    slopes
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
            assert!(error < 2e-5, "{case}, {level:?}: gradient {i} {error:.1e}");
        }
    });
}
