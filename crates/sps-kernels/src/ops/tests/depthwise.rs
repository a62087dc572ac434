//! Convolution of each channel by itself, against its definition in f64.

use super::super::bands::Threads;
use super::super::conv::Conv;
use super::super::grid::{Grid, Window, pixels};
use super::super::product::{Activation, Columns, Epilogue};
use super::super::simd::Level;
use super::super::words::{Bf16Pair, Word};
use super::{noise, shape};

/// Sums over the window, plus a shift, within 0 to 6; in f64.
fn reference(
    window: &Window,
    size: [usize; 3],
    x: &[f64],
    weights: &[f64],
    shift: &[f64],
) -> Vec<f64> {
    let channels = shift.len();
    let [_, height, width] = size;
    let [_, rows, columns] = window.output(size).unwrap();
    let [_, taps_y, taps_x] = window.size;
    let mut out = Vec::new();
    for (y, x_) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
        for (channel, shift) in shift.iter().enumerate() {
            let mut sum = *shift;
            for (i, j) in (0..taps_y).flat_map(|i| (0..taps_x).map(move |j| (i, j))) {
                let row = (y * window.stride[1] + i).wrapping_sub(window.before[1]);
                let column = (x_ * window.stride[2] + j).wrapping_sub(window.before[2]);
                if row < height && column < width {
                    let weight = weights[(channel * taps_y + i) * taps_x + j];
                    sum += x[(row * width + column) * channels + channel] * weight;
                }
            }
            out.push(sum.clamp(0.0, 6.0));
        }
    }
    out
}

/// A convolution's sums may be off by `rounding` of themselves and by what sums in f32 lose.
fn check<W: Word>(window: Window, size: [usize; 3], channels: usize, rounding: f64) {
    let shape = shape(window, channels, channels, channels);
    let as_words = |values: &[f64]| -> Vec<W> {
        let words = values.chunks_exact(W::NUMBERS);
        words.map(|w| W::of(|i| w[i] as f32)).collect()
    };
    let values = as_words(&noise(pixels(size) * channels, 1));
    let x: Vec<f64> = W::numbers(&values).map(f64::from).collect();
    let (weights, shift) = (noise(channels * pixels(window.size), 2), noise(channels, 3));
    let weights: Vec<f64> = weights.iter().map(|w| 3.0 * w).collect();
    let expected = reference(&window, size, &x, &weights, &shift);
    Level::on_each(|level| {
        let narrow = |values: &[f64]| -> Vec<f32> { values.iter().map(|&v| v as f32).collect() };
        let (weights, shift) = (narrow(&weights), narrow(&shift));
        let conv = Conv::<W>::pack(level, shape, &weights);
        // A border wider than the window's, as another reader may need it.
        let wider = Window::square(9, 1, 4);
        let from = Grid::tight(1, size, channels).of::<W>().enclosing(&wider);
        let mut source = vec![W::default(); from.len()];
        for (&place, pixel) in from.places().iter().zip(values.chunks(from.pitch)) {
            source[place..][..from.pitch].copy_from_slice(pixel);
        }
        let to = Grid::tight(1, window.output(size).unwrap(), channels).of::<W>();
        let mut target = vec![W::default(); to.len()];
        let epilogue = Epilogue {
            shift: Some(Columns::shared(&shift)),
            limits: Activation::Relu6.limits(),
            ..Epilogue::default()
        };
        conv.apply(Threads::One, (&source, &from), (&mut target, &to), epilogue);
        for (i, (found, expected)) in W::numbers(&target).zip(&expected).enumerate() {
            let error = (f64::from(found) - expected).abs();
            let bound = rounding * expected + 1e-5;
            assert!(
                error <= bound,
                "{level:?} {window:?} {i}: {found} for {expected}"
            );
        }
    });
}

#[test]
fn depthwise_convolutions() {
    for channels in [2, 24, 32, 40, 144] {
        for (window, size) in [
            (Window::square(5, 1, 2), [1, 7, 10]),
            (Window::square(3, 2, 1), [1, 9, 8]),
            (Window::square(7, 1, 3), [1, 4, 5]),
            (Window::square(3, 1, 1), [1, 6, 5]),
            (Window::square(5, 2, 2), [1, 7, 9]),
            (Window::square(3, 1, 1), [1, 3, 16]),
            (Window::square(3, 2, 1), [1, 5, 31]),
            (Window::square(5, 1, 2), [1, 2, 7]),
            (Window::square(5, 2, 2), [1, 6, 15]),
            (Window::same([1, 5, 5], [1, 2, 2], [1, 8, 6]), [1, 8, 6]),
            (Window::same([1, 3, 3], [1, 2, 2], [1, 1, 1]), [1, 1, 1]),
        ] {
            check::<f32>(window, size, channels, 1e-6);
            check::<Bf16Pair>(window, size, channels, 1.0 / 256.0);
        }
    }
    check::<f32>(Window::square(3, 1, 1), [1, 4, 4], 5, 1e-6);
}

/// Where a number goes through a rectifier or a limit, it is no number.
#[test]
fn what_is_no_number_stays_so() {
    let window = Window::square(1, 1, 0);
    let shape = |groups| shape(window, 8, 8, groups);
    let grid = Grid::tight(1, [1; 3], 8);
    Level::on_each(|level| {
        for groups in [1, 8] {
            let conv = Conv::<f32>::pack(level, shape(groups), &vec![1.0; 64 / groups]);
            let mut target = vec![0.0; 8];
            let epilogue = Epilogue {
                limits: Activation::Relu6.limits(),
                ..Epilogue::default()
            };
            let source = [f32::NAN; 8];
            conv.apply(
                Threads::One,
                (&source, &grid),
                (&mut target, &grid),
                epilogue,
            );
            assert!(target.iter().all(|v| v.is_nan()), "{level:?}");
        }
    });
}
