//! Convolution of each channel by itself, against its definition in f64.

use super::*;

/// With a border wider than the window's, as another reader may need it.
fn check<W: Word>(window: Window, size: [usize; 3], channels: usize, rounding: f64) {
    let case = Case::new(1, size, [channels; 3], window);
    let weights = noise(case.weights(), 2).into_iter().map(|w| 3.0 * w);
    let (weights, wider) = (weights.collect::<Vec<_>>(), Window::square(9, 1, 4));
    let (border, bounds) = ((&case, &wider), [rounding, 1e-5]);
    check_sums::<W>(border, &weights, Activation::Relu6, bounds);
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
            let mut target = [0.0; 8];
            let epilogue = Epilogue {
                limits: Activation::Relu6.limits(),
                ..Epilogue::default()
            };
            let (source, to) = ((&[f32::NAN; 8][..], &grid), (&mut target[..], &grid));
            conv.apply(Threads::One, source, to, epilogue);
            assert!(target.iter().all(|v| v.is_nan()), "{level:?}");
        }
    });
}
