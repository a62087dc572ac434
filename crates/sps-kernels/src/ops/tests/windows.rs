//! Windows and feature maps of extents that no program should trust.

use super::super::grid::{Grid, Window};
use super::shape;
use crate::{Convolution, MaxPooling};

#[test]
fn windows_without_extent_are_refused() {
    let conv = |window| Convolution::new(1, [1, 4, 4], shape(window, 2, 2, 1));
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
        let error = conv(window).unwrap_err().to_string();
        let found = "convolution: found 1 frames of [1, 4, 4]";
        assert!(error.starts_with(found), "{error}");
        for ceil in [false, true] {
            let error = MaxPooling::new(1, [1, 4, 4], 2, window, ceil).unwrap_err();
            let found = "max pooling: found 1 frames of [1, 4, 4]";
            assert!(error.to_string().starts_with(found), "{error}");
        }
    }
    assert!(conv(sound).is_ok());
}

/// Two frames of 2.5 billion words each: the second begins where 32 bits no longer reach.
#[test]
fn feature_maps_beyond_32_bits() {
    let grid = Grid::tight(2, [1, 50_000, 50_000], 1);
    let starts = grid.steps(0..2, [0; 3], [1, 1, 3], [1, 1, 7]);
    let second = [2_500_000_000, 2_500_000_007, 2_500_000_014];
    assert_eq!(starts, [[0, 7, 14], second].concat());
    let far = Grid::tight(3, [1, 50_000, 50_000], 1).steps(0..3, [0; 3], [1; 3], [1; 3]);
    assert_eq!(far, [0, 2_500_000_000, 5_000_000_000]);
}
