//! Convolution, pooling and mean of bf16 feature maps, against f64 on the same rounded numbers; gradients
//! and batch norm against those of f32, which other tests hold to f64.

use half::bf16;

use super::conv::cases;
use super::*;
use crate::ops::batch_norm::{FrameSums, Norm, NormGradients, Slopes};
use crate::ops::pointwise::Shortcut;
use crate::ops::pool::max_pool_backward;
use crate::ops::statistics::ChannelStatistics;

fn rounded(values: &[f64]) -> Vec<f64> {
    super::rounded::<Bf16Pair>(values)
}

/// What a number differs by once it is rounded to eight bits.
const ROUNDING: f64 = 1.0 / 256.0;

#[test]
fn convolutions() {
    for case in cases::<Bf16Pair>() {
        let weights = rounded(&noise(case.weights(), 2));
        // Sums of as many products as there are, each of at most 1, in f32.
        let slack = 1e-6 * (case.weights() / case.shape.outputs) as f64;
        let border = (&case, &case.shape.window);
        check_sums::<Bf16Pair>(border, &weights, Activation::Relu, [ROUNDING, slack]);
    }
}

/// Neither rounds: the largest number is one of those that are there, and the sum is of f32.
#[test]
fn pooling_and_means() {
    let is_mean = |found: f32, mean: f64| (f64::from(found) - mean).abs() < 1e-7;
    check_pooling_and_means::<Bf16Pair>(&rounded(&noise(7 * 6 * 32, 5)), is_mean);
}

/// Words of numbers that are rounded to bf16, those of a border 0.
fn map<W: Word>(grid: &Grid, seed: u64) -> Vec<W> {
    let tight = grid.frames * pixels(grid.size) * grid.channels;
    laid_out(&rounded(&noise(tight, seed)), grid, 0.0)
}

#[test]
fn gradients_of_convolutions() {
    for case in cases::<Bf16Pair>() {
        let case = Case { frames: 2, ..case };
        let Case { shape, size, .. } = case;
        let weights = narrow(&rounded(&noise(case.weights(), 1)));
        let [of_weights, input] = gradients(Level::detect(), &case, &weights, map::<f32>);
        let products = 2 * pixels(case.size);
        Level::on_each(|level| {
            let found = gradients(level, &case, &weights, map::<Bf16Pair>);
            for (found, expected) in found[0].iter().zip(&of_weights) {
                let error = (found - expected).abs();
                let bound = 1e-6 * products as f64;
                assert!(
                    error <= bound,
                    "{level:?} {shape:?} {size:?} weights: {error}"
                );
            }
            let slack = 1e-6 * (shape.group_outputs() * pixels(shape.window.size)) as f64;
            for (found, expected) in found[1].iter().zip(&input) {
                let error = (found - expected).abs();
                let bound = ROUNDING * expected.abs() + slack;
                assert!(
                    error <= bound,
                    "{level:?} {shape:?} {size:?} input: {error}"
                );
            }
        });
    }
}

/// Each window's gradient goes to the same number as in f32, also where several are the largest.
#[test]
fn gradients_of_pooling() {
    fn gradient<W: Real>(level: Level, size: usize) -> Vec<f32> {
        let window = Window::square(size, 2, 0);
        let from = Grid::tight(2, [1, 7, 6], 34).of::<W>();
        let to = Grid {
            size: window.output_ceil(from.size),
            ..from
        };
        let mut source = map::<W>(&from, 5);
        // Few different numbers.
        for number in W::each_mut(&mut source) {
            *number = W::narrowed((4.0 * W::widened(*number)).round());
        }
        let mut pooled = vec![W::default(); to.len()];
        let source = (&source[..], &from);
        max_pool(Threads::One, level, &window, source, (&mut pooled, &to));
        let (mut target, gradient) = (vec![W::default(); from.len()], map::<W>(&to, 6));
        let pooled = (&pooled[..], &to);
        max_pool_backward(level, &window, source, pooled, &gradient, &mut target);
        W::numbers(&target).collect()
    }
    Level::on_each(|level| {
        assert_eq!(gradient::<Bf16Pair>(level, 2), gradient::<f32>(level, 2));
        let (found, expected) = (gradient::<Bf16Pair>(level, 3), gradient::<f32>(level, 3));
        for (found, expected) in found.iter().zip(&expected) {
            let error = f64::from((found - expected).abs());
            assert!(error <= 2.0 * ROUNDING * f64::from(expected.abs()).max(1.0));
        }
    });
}

/// What a pass over feature maps leaves: maps, and sums.
type Left = (Vec<Vec<f32>>, FrameSums);

/// Numbers from a quarter to one and a quarter.
fn parameters(len: usize, seed: u64) -> Vec<f32> {
    let numbers = noise(len, seed).into_iter();
    numbers.map(|x| 0.75 + 0.5 * x as f32).collect()
}

const CHANNELS: usize = 34;

fn norm_of<W: Real>(level: Level, x: &[W], grid: &Grid) -> Norm {
    let statistics = ChannelStatistics::of(level, x, grid);
    let (gamma, beta) = (parameters(CHANNELS, 11), parameters(CHANNELS, 12));
    Norm::new(&statistics, &gamma, &beta, 1e-5)
}

/// Batch norm with a rectifier, forward and backward, into a map with a border.
fn norm<W: Real>(level: Level) -> Left {
    let grid = Grid::tight(2, [1, 7, 6], CHANNELS).of::<W>();
    let to = grid.padded(&Window::square(3, 1, 1));
    let (x, gradient) = (map::<W>(&grid, 1), map::<W>(&grid, 2));
    let norm = norm_of(level, &x, &grid);
    let activation = Activation::Relu6;
    let (mut y, mut dx) = (vec![W::default(); to.len()], vec![W::default(); grid.len()]);
    norm.apply(level, (&x, &grid), None, (&mut y, &to), activation);
    let sums = norm.sums(level, &x, &gradient, &grid, activation);
    let slopes = NormGradients::new(&norm, &sums.over_frames(CHANNELS)).slopes;
    let ends = [&x[..], &gradient];
    norm.backward(level, &slopes, ends, (&mut dx, &grid), Some(activation));
    let maps = [y, dx].map(|map| W::numbers(&map).collect());
    (maps.to_vec(), sums)
}

/// The end of a residual branch, forward onto either kind of shortcut, and backward.
fn residual<W: Real>(level: Level) -> Left {
    let grid = Grid::tight(2, [1, 7, 6], CHANNELS).of::<W>();
    let (x, added) = (map::<W>(&grid, 1), map::<W>(&grid, 2));
    let norm = norm_of(level, &x, &grid);
    let other = norm_of(level, &added, &grid);
    let gate = parameters(2 * CHANNELS, 13);
    let (x, activation) = ((&x[..], &grid), Activation::Relu);
    let [mut plain, mut normed, mut dx] = [0; 3].map(|_| vec![W::default(); grid.len()]);
    for (shortcut, target) in [
        (Shortcut::Plain(&added, &grid), &mut plain),
        (Shortcut::Normed(&added, &other), &mut normed),
    ] {
        let onto = Some((&gate[..], shortcut));
        norm.apply(level, x, onto, (target, &grid), activation);
    }
    let (end, mut masked) = (map::<W>(&grid, 3), map::<W>(&grid, 4));
    let sums = norm.mask(level, x, (&end, &grid), &mut masked, activation);
    let slopes = Slopes {
        of_gradient: gate.clone(),
        of_x: parameters(CHANNELS, 14),
        constant: parameters(2 * CHANNELS, 15),
    };
    let ends = [x.0, &masked];
    norm.backward(level, &slopes, ends, (&mut dx, &grid), None);
    let maps = [plain, normed, masked, dx].map(|map| W::numbers(&map).collect());
    (maps.to_vec(), sums)
}

/// Both compute in f32: of the same rounded numbers the sums are the same, and maps are those of f32,
/// rounded.
fn rounds_maps_alone(single: fn(Level) -> Left, pair: fn(Level) -> Left) {
    Level::on_each(|level| {
        let ((maps, sums), (expected, of_f32)) = (pair(level), single(level));
        for (found, expected) in maps.iter().zip(&expected) {
            let round = |&x: &f32| Bf16Pair::widened(Bf16Pair::narrowed(x));
            let rounded: Vec<f32> = expected.iter().map(round).collect();
            assert_eq!(*found, rounded, "{level:?}");
        }
        assert_eq!(sums.gradient, of_f32.gradient, "{level:?}");
        assert_eq!(sums.product, of_f32.product, "{level:?}");
    });
}

#[test]
fn batch_norm_in_training() {
    rounds_maps_alone(norm::<f32>, norm::<Bf16Pair>);
}

#[test]
fn the_end_of_a_residual_branch() {
    rounds_maps_alone(residual::<f32>, residual::<Bf16Pair>);
}

/// As the processor's own instruction rounds, ties to even; NaN stays NaN.
#[test]
fn numbers_are_narrowed() {
    let ulp = 1.0 / 128.0;
    for (number, expected) in [
        (1.0, 1.0),
        (1.0 + ulp / 2.0, 1.0),
        (1.0 + 1.5 * ulp, 1.0 + 2.0 * ulp),
        (-1.0 - 0.51 * ulp, -1.0 - ulp),
        (f32::MAX, f32::INFINITY),
        (f32::NEG_INFINITY, f32::NEG_INFINITY),
    ] {
        let found = Bf16Pair::widened(Bf16Pair::narrowed(number));
        assert_eq!(found, expected, "{number}");
    }
    assert!(Bf16Pair::widened(Bf16Pair::narrowed(f32::NAN)).is_nan());
}

/// A matrix is rounded in vectors as `half` rounds one number: ties, infinities, subnormal numbers and NaN too.
#[test]
fn matrices_are_rounded_as_numbers_are() {
    let upper = (0..=u16::MAX).step_by(97);
    let lower = [0, 1, 0x7fff, 0x8000, 0x8001, 0xffff];
    let numbers = upper.flat_map(|upper| lower.map(|lower| u32::from(upper) << 16 | lower));
    let numbers: Vec<f32> = numbers.map(f32::from_bits).collect();
    let bits = |numbers: &[bf16]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let expected: Vec<bf16> = numbers.iter().map(|&x| bf16::from_f32(x)).collect();
    Level::on_each(|level| {
        let words = Bf16Pair::of_weights(level, &numbers);
        let found = &Bf16Pair::each(&words)[..numbers.len()];
        assert_eq!(bits(found), bits(&expected), "{level:?}");
    });
}

/// NaN stays in the maximum wherever it lies, with either sign, and numbers below 0 keep their order.
#[test]
fn the_largest_number() {
    fn pool<W: Word>(level: Level, values: [f32; 4]) -> Vec<f32> {
        let (from, to) = (Grid::tight(1, [1, 2, 2], 2), Grid::tight(1, [1; 3], 2));
        let (from, to) = (from.of::<W>(), to.of::<W>());
        let source: Vec<W> = laid_out(&values.map(|x| [f64::from(x); 2]).concat(), &from, 0.0);
        let mut target = vec![W::default(); to.len()];
        let (window, ends) = (Window::square(2, 2, 0), (&mut target[..], &to));
        max_pool(Threads::One, level, &window, (&source, &from), ends);
        W::numbers(&target).collect()
    }
    Level::on_each(|level| {
        for pool in [pool::<f32>, pool::<Bf16Pair>] {
            let largest = pool(level, [-3.0, -1.0, -2.0, -4.0]);
            assert_eq!(largest, [-1.0; 2], "{level:?}");
            for nan in [f32::NAN, -f32::NAN] {
                for position in 0..4 {
                    let mut values = [1.0, f32::INFINITY, 0.0, -1.0];
                    values[position] = nan;
                    let found = pool(level, values);
                    assert!(found.iter().all(|x| x.is_nan()), "{level:?} {position}");
                }
            }
        }
    });
}
