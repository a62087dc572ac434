//! What several test files need.
#![allow(dead_code, reason = "each test file uses some of it")]

use std::path::{Path, PathBuf};

use sps_dataset::{DecodeSettings, Decoded, Frame, FrameErrorKind, decode_image};

pub(crate) fn tiny_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/tiny-dataset")
}

/// A file of `tests/data`.
pub(crate) fn data(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let path = folder.join(name);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A file of `tests/data`, decoded with the default settings.
pub(crate) fn decoded(name: &str) -> Decoded {
    decoded_with(name, &DecodeSettings::default()).unwrap_or_else(|error| panic!("{name}: {error}"))
}

pub(crate) fn decoded_with(
    name: &str,
    settings: &DecodeSettings,
) -> Result<Decoded, FrameErrorKind> {
    decode_image(&data(name), settings)
}

/// Settings with a limit of so many pixels.
pub(crate) fn at_most(pixels: u64) -> DecodeSettings {
    let mut settings = DecodeSettings::default();
    settings.limits.pixels = pixels;
    settings
}

/// A file of `tests/data` that ends early, wherever it does, is no image.
pub(crate) fn cut_anywhere(name: &str) {
    let bytes = data(name);
    for cut in 0..bytes.len() {
        let refused = decode_image(&bytes[..cut], &DecodeSettings::default());
        let of = bytes.len();
        assert!(refused.is_err(), "{name} cut after {cut} of {of} bytes");
    }
}

/// The sRGB transfer function (IEC 61966-2-1) in double precision.
pub(crate) fn srgb(light: f64) -> f64 {
    let light = light.clamp(0.0, 1.0);
    if light <= 0.003_130_8 {
        light * 12.92
    } else {
        1.055 * light.powf(1.0 / 2.4) - 0.055
    }
}

/// Compares every value with what `expected(x, y)` says.
pub(crate) fn check(
    name: &str,
    frame: &Frame,
    size: (usize, usize),
    bound: f64,
    expected: impl Fn(usize, usize) -> [f64; 3],
) {
    assert_eq!((frame.width, frame.height), size, "{name}");
    assert_eq!(frame.data.len(), size.0 * size.1 * 3, "{name}");
    let found = |x, y| {
        let at = (y * size.0 + x) * 3;
        [0, 1, 2].map(|channel| f64::from(frame.data[at + channel]))
    };
    let (error, place) = furthest(size, found, expected);
    println!("{name}: error {error:.1e}, bound {bound:.1e}");
    assert!(error <= bound, "{name}: off by {error} at {place:?}");
}

/// Holds that a naive form, by what it makes of each pixel, misses the bound.
pub(crate) fn naive_misses(
    name: &str,
    size: (usize, usize),
    bound: f64,
    naive: impl Fn(usize, usize) -> [f64; 3],
    expected: impl Fn(usize, usize) -> [f64; 3],
) {
    let (error, _) = furthest(size, naive, expected);
    println!("{name}: naive form {error:.1e}");
    assert!(
        error > bound,
        "{name}: the naive form is off by {error} only"
    );
}

/// The largest difference, infinite where a value is no number, and its pixel.
fn furthest(
    size: (usize, usize),
    found: impl Fn(usize, usize) -> [f64; 3],
    expected: impl Fn(usize, usize) -> [f64; 3],
) -> (f64, (usize, usize)) {
    let mut furthest = (0.0, (0, 0));
    for (x, y) in (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y))) {
        for (found, expected) in found(x, y).into_iter().zip(expected(x, y)) {
            let error = (found - expected).abs();
            let error = if error.is_nan() { f64::INFINITY } else { error };
            if error > furthest.0 {
                furthest = (error, (x, y));
            }
        }
    }
    furthest
}
