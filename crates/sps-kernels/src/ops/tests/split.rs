//! Convolutions of f32 as sums of two numbers of bf16, against f64; where there are no tiles they are those of f32.

use super::super::bands::Threads;
use super::super::conv::{Conv, ConvShape};
use super::super::grid::{Grid, Window, pixels};
use super::super::product::{Activation, Epilogue};
use super::super::simd::Level;
use super::conv::Case;
use super::{convolved, distance, narrow, noise, shape};

/// What a convolution adds to what is stored, whose first numbers are its shifts too.
fn convolve(
    (conv, shape): (&Conv, ConvShape),
    [height, width]: [usize; 2],
    values: &[f64],
    stored: &[f64],
) -> Vec<f64> {
    let grid = Grid::tight(1, [1, height, width], shape.inputs);
    let to = shape.window.output(grid.size).unwrap();
    let to = Grid::tight(1, to, shape.outputs);
    let shift = narrow(&stored[..shape.outputs]);
    let by = |threads| {
        let epilogue = Epilogue {
            accumulate: Some(1.0),
            ..Epilogue::biased(&shift, Activation::Relu)
        };
        let source = (values, &grid.padded(&shape.window), 0.0);
        convolved((conv, threads), source, (stored, &to), epilogue)
    };
    let alone = by(Threads::One);
    let mut pairs = by(Threads::All).into_iter().zip(&alone);
    assert!(pairs.all(|(x, y)| x.to_bits() == y.to_bits() || x.is_nan() && y.is_nan()));
    alone
}

fn check(shape: ConvShape, size: [usize; 2], scale: f64) {
    // Of 24 bits, so that both halves round.
    let scaled = |noise: Vec<f64>| noise.into_iter().map(move |x| x * scale * 1.000_077);
    let single = |x: f64| f64::from(x as f32);
    let values = scaled(noise(size[0] * size[1] * shape.inputs, 1)).map(single);
    let values: Vec<f64> = values.collect();
    let taps = pixels(shape.window.size);
    let weights = noise(shape.outputs * shape.group_inputs() * taps, 2);
    let weights: Vec<f64> = weights.into_iter().map(|w| single(w * 0.1)).collect();
    let sums = Case::of_image(shape, size).reference(&values, &weights);
    let stored: Vec<f64> = scaled(noise(sums.len(), 4)).map(single).collect();
    let shifted = sums.iter().zip(&stored).enumerate();
    let shifted = shifted.map(|(i, (sum, x))| (sum + x + stored[i % shape.outputs]).max(0.0));
    let expected: Vec<f64> = shifted.map(|x| x / scale).collect();
    Level::on_each(|level| {
        let conv = Conv::pack_split(level, shape, &narrow(&weights));
        let found = convolve((&conv, shape), size, &values, &stored);
        let found: Vec<f64> = found.iter().map(|x| x / scale).collect();
        let error = distance(&found, &expected);
        assert!(error < 1e-5, "{level:?} {shape:?}: off by {error:.1e}");
    });
}

#[test]
fn convolutions() {
    let (point, square) = (Window::square(1, 1, 0), Window::square(3, 1, 1));
    let (halving, jumping) = (Window::square(1, 2, 0), Window::square(3, 2, 1));
    for scale in [1.0, 1e-20, 1e30] {
        check(shape(point, 64, 48, 1), [5, 7], scale);
        check(shape(square, 64, 32, 1), [11, 10], scale);
    }
    check(shape(point, 300, 32, 1), [1, 1], 1.0);
    check(shape(halving, 24, 64, 1), [7, 5], 1.0);
    check(shape(square, 40, 80, 1), [6, 17], 1.0);
    // Columns that fill no vector, channels that fill no word.
    check(shape(point, 7, 10, 1), [3, 3], 1.0);
    for window in [square, jumping] {
        check(shape(window, 128, 128, 32), [9, 6], 1.0);
        check(shape(window, 64, 64, 8), [6, 9], 1.0);
        check(shape(window, 64, 64, 2), [5, 5], 1.0);
        check(shape(window, 64, 64, 64), [5, 5], 1.0);
    }
}

/// What is not finite stays so, where it is: infinity times a lower half of 0 is no number.
#[test]
fn numbers_beyond_all() {
    let shape = shape(Window::square(3, 1, 1), 32, 16, 1);
    let weights = vec![0.5; 16 * 32 * 9];
    let mut values = vec![1.0; 9 * 8 * 32];
    (values[0], values[35 * 32 + 3]) = (f64::INFINITY, f64::NAN);
    let stored = vec![0.0; 9 * 8 * 16];
    let in_f32 = Conv::pack(Level::Portable, shape, &weights);
    let in_f32 = convolve((&in_f32, shape), [9, 8], &values, &stored);
    Level::on_each(|level| {
        let conv = Conv::pack_split(level, shape, &weights);
        let found = convolve((&conv, shape), [9, 8], &values, &stored);
        for (found, expected) in found.iter().zip(&in_f32) {
            let same = (found - expected).abs() < 1e-3;
            assert!(
                same || !found.is_finite() && !expected.is_finite(),
                "{found} {expected}"
            );
        }
    });
}
