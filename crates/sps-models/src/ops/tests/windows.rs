//! Windows and feature maps of extents that no program should trust.

use candle_core::{Device, Tensor};

use super::super::grid::Grid;
use super::super::{Window, conv, max_pool};

#[test]
fn windows_without_extent_are_refused() {
    let x = Tensor::ones((1, 4, 4, 2), candle_core::DType::F32, &Device::Cpu).unwrap();
    let weight = Tensor::ones((2, 2, 3, 3), candle_core::DType::F32, &Device::Cpu).unwrap();
    let sound = Window::square(3, 1, 1);
    let with = |change: fn(&mut Window)| {
        let mut window = sound;
        change(&mut window);
        window
    };
    for window in [
        Window::square(3, 0, 1),
        with(|w| w.stride = [0, 1, 1]),
        with(|w| w.stride[1] = usize::MAX),
        with(|w| w.size[2] = 0),
        with(|w| w.size = [usize::MAX; 3]),
        with(|w| w.before[1] = usize::MAX),
        with(|w| w.after[2] = usize::MAX),
        with(|w| w.before[2] = 3),
        Window::same([1, 3, 3], [0; 3], [1, 4, 4]),
        Window::same([usize::MAX; 3], [1; 3], [4; 3]),
    ] {
        let error = conv(&x, &weight, window, 1).unwrap_err().to_string();
        assert!(
            error.starts_with("convolution: found x [1, 4, 4, 2]"),
            "{error}"
        );
        for ceil in [false, true] {
            let error = max_pool(&x, window, ceil).unwrap_err().to_string();
            assert!(
                error.starts_with("max pooling: found [1, 4, 4, 2]"),
                "{error}"
            );
        }
    }
    // Weights without a pixel, of which there are no taps.
    let none = Tensor::ones((2, 2, 0, 3), candle_core::DType::F32, &Device::Cpu).unwrap();
    let window = with(|w| w.size = [1, 0, 3]);
    assert!(conv(&x, &none, window, 1).is_err());
    assert!(conv(&x, &weight, sound, 1).is_ok());
}

/// Two frames of 2.5 billion words each: the second begins where 32 bits no longer reach.
#[test]
fn feature_maps_beyond_32_bits() {
    let grid = Grid::tight(2, [1, 50_000, 50_000], 1);
    let starts = grid.steps(0..2, [0; 3], [1, 1, 3], [1, 1, 7]);
    assert_eq!(
        starts,
        [0, 7, 14, 2_500_000_000, 2_500_000_007, 2_500_000_014]
    );
    let far = Grid::tight(3, [1, 50_000, 50_000], 1).steps(0..3, [0; 3], [1; 3], [1; 3]);
    assert_eq!(far, [0, 2_500_000_000, 5_000_000_000]);
}
