//! What several test files need.
#![allow(dead_code, reason = "each test file uses some of it")]

use std::path::PathBuf;

use sps_dataset::{DecodeSettings, Decoded, Frame, FrameErrorKind, decode_image};

/// A file of `tests/data`.
pub(crate) fn data(name: &str) -> Vec<u8> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name);
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
    for y in 0..size.1 {
        for x in 0..size.0 {
            for (channel, expected) in expected(x, y).into_iter().enumerate() {
                let found = f64::from(frame.data[(y * size.0 + x) * 3 + channel]);
                assert!(
                    (found - expected).abs() <= bound,
                    "{name}: ({x}, {y}) channel {channel} is {found}, expected {expected}"
                );
            }
        }
    }
}
