//! Convolution of each channel by itself, against its definition in f64.

use super::super::bands::Threads;
use super::super::conv::Conv;
use super::super::grid::{Grid, Window, pixels};
use super::super::product::{Activation, Epilogue};
use super::super::simd::Level;
use super::super::words::{Bf16Pair, Word};
use super::conv::Case;
use super::{convolved, inside, laid_out, narrow, noise, shape};

/// A convolution's sums may be off by `rounding` of themselves and by what sums in f32 lose.
fn check<W: Word>(window: Window, size: [usize; 3], channels: usize, rounding: f64) {
    let shape = shape(window, channels, channels, channels);
    let tight = Grid::tight(1, size, channels).of::<W>();
    let x = laid_out::<W>(&noise(pixels(size) * channels, 1), &tight, 0.0);
    let x = inside(&x, &tight);
    let (weights, shift) = (noise(channels * pixels(window.size), 2), noise(channels, 3));
    let weights: Vec<f64> = weights.iter().map(|w| 3.0 * w).collect();
    let sums = Case::of_image(shape, [size[1], size[2]]).reference(&x, &weights);
    let (weights, shift_of) = (narrow(&weights), narrow(&shift));
    Level::on_each(|level| {
        let conv = Conv::<W>::pack(level, shape, &weights);
        // A border wider than the window's, as another reader may need it.
        let from = tight.enclosing(&Window::square(9, 1, 4));
        let to = Grid::tight(1, window.output(size).unwrap(), channels).of::<W>();
        let epilogue = Epilogue::biased(&shift_of, Activation::Relu6);
        let found = convolved(
            (&conv, Threads::One),
            (&x, &from, 0.0),
            (&[], &to),
            epilogue,
        );
        assert_eq!(found.len(), sums.len());
        for (i, (found, sum)) in found.into_iter().zip(&sums).enumerate() {
            let expected = (sum + shift[i % channels]).clamp(0.0, 6.0);
            let error = (found - expected).abs();
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
