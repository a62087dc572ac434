//! EXR files that OpenEXR wrote (`data/make_exr.cpp`), against the formulas of their content.

use crate::common::{at_most, check, cut_anywhere, data, decoded, decoded_with, srgb};
use sps_dataset::{DecodeSettings, Decoded, LightCounts, NonFinite, decode_image};

const SIZE: (usize, usize) = (24, 36);

/// Far below a step of 8 bits (0.004); a single-precision power is good to about 1e-7.
const EXACT: f64 = 1e-6;

fn light(x: usize, y: usize) -> [f64; 3] {
    let (x, y) = (x as f64, y as f64);
    [(x + 1.0) / 32.0, (y + 1.0) / 64.0, x * y / 1024.0]
}

fn rgb(x: usize, y: usize) -> [f64; 3] {
    light(x, y).map(srgb)
}

fn grey(x: usize, y: usize) -> [f64; 3] {
    [srgb((x + y) as f64 / 64.0); 3]
}

/// Compares the picture of a file with what is expected of each pixel.
fn shows(file: &str, bound: f64, expected: impl Fn(usize, usize) -> [f64; 3]) {
    let frame = decoded(&format!("exr/{file}.exr")).frame;
    check(file, &frame, SIZE, bound, expected);
}

#[test]
fn every_lossless_compression_and_type() {
    for compression in ["none", "rle", "zips", "zip", "piz", "pxr24"] {
        for kind in ["half", "float"] {
            let file = format!("{kind}-{compression}");
            shows(&file, EXACT, rgb);
            let light = decoded(&format!("exr/{file}.exr")).light;
            assert_eq!(light, LightCounts::default(), "{file}");
        }
    }
    // Of `mipmap` and `ripmap`, the full resolution.
    for file in "mixed decreasing offset tiled mipmap ripmap".split(' ') {
        shows(file, EXACT, rgb);
    }
    shows("grey", EXACT, grey);
}

/// What OpenEXR's own reader made of a file.
fn reference(file: &str) -> impl Fn(usize, usize) -> [f64; 3] {
    let bytes = data(&format!("exr/{file}.f32"));
    let (floats, _) = bytes.as_chunks::<4>();
    let floats = floats.iter().map(|&float| f32::from_le_bytes(float));
    let floats: Vec<f64> = floats.map(f64::from).collect();
    move |x, y| [0, 1, 2].map(|channel| srgb(floats[(y * SIZE.0 + x) * 3 + channel]))
}

#[test]
fn lossy_compressions_as_openexr_reads_them() {
    for file in ["half-b44", "half-dwaa"] {
        shows(file, EXACT, reference(file));
    }
}

#[test]
fn unsigned_integers_are_light_as_they_stand() {
    for file in ["uint", "uint-pxr24"] {
        let square = |step: usize, x: usize, y: usize| ((x / step + y / step) % 2) as f64;
        shows(file, EXACT, |x, y| [1, 2, 4].map(|step| square(step, x, y)));
    }
}

fn layer(name: &str) -> DecodeSettings {
    DecodeSettings {
        exr_layer: Some(name.to_owned()),
        ..DecodeSettings::default()
    }
}

#[test]
fn layers_and_parts_are_found_by_name() {
    // The part `beauty` is the first with a picture; `depth` has none.
    for file in ["parts", "deep-and-flat", "layer"] {
        shows(file, EXACT, rgb);
    }
    for (file, name, is_grey) in [
        ("parts", "beauty", false),
        ("parts", "grey", true),
        ("layers", "left", false),
        ("layers", "right", true),
    ] {
        let decoded = decoded_with(&format!("exr/{file}.exr"), &layer(name)).unwrap();
        let expected = if is_grey { grey } else { rgb };
        check(name, &decoded.frame, SIZE, EXACT, expected);
    }
}

fn refusal(file: &str, settings: &DecodeSettings) -> String {
    let refused = decoded_with(&format!("exr/{file}.exr"), settings);
    refused.unwrap_err().to_string()
}

#[test]
fn what_is_missing_or_ambiguous_is_named() {
    let ambiguous = "has the channels left.B, left.G, left.R, right.Y; expected `exr-layer` to say \
                     which of `left`, `right`";
    assert_eq!(refusal("layers", &DecodeSettings::default()), ambiguous);
    let missing =
        "has the channels Z, B, G, R, Y; expected the layer `buty` to be one of `beauty`, `grey`";
    assert_eq!(refusal("parts", &layer("buty")), missing);
}

#[test]
fn exposure_brightens_before_clipping() {
    let settings = DecodeSettings {
        exposure_stops: 2.0,
        ..DecodeSettings::default()
    };
    let decoded = decoded_with("exr/half-zip.exr", &settings).unwrap();
    let exposed = |x, y| light(x, y).map(|light| light * 4.0);
    let expected = |x, y| exposed(x, y).map(srgb);
    check("exposed", &decoded.frame, SIZE, EXACT, expected);
    let pixels = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| exposed(x, y)));
    let clipped = pixels.flatten().filter(|&light| light > 1.0).count();
    assert_eq!(decoded.light.clipped, clipped);
}

#[test]
fn a_block_that_is_twice_there_or_missing_is_an_error() {
    let bytes = data("exr/half-none.exr");
    // One row per block: 4 bytes row, 4 bytes size, 24 pixels of 6 bytes; the last ends the file.
    let block = 8 + 24 * 6;
    let last = bytes.len() - block;
    let mut twice = bytes.clone();
    twice.copy_within(last - block..last, last);
    let refused = decode_image(&twice, &DecodeSettings::default()).unwrap_err();
    assert!(refused.to_string().contains("twice"), "{refused}");
}

#[test]
fn a_block_that_passes_for_another_levels_leaves_a_gap() {
    let mut bytes = data("exr/mipmap.exr");
    // Column 1, row 2 of the full resolution.
    let tile = [1_u32, 2, 0, 0].map(u32::to_le_bytes).concat();
    let at = bytes.windows(16).position(|window| window == tile).unwrap();
    bytes[at + 8] = 1;
    bytes[at + 12] = 1;
    let refused = decode_image(&bytes, &DecodeSettings::default()).unwrap_err();
    let expected = "is not a whole EXR image: 1 of its 18 blocks are missing";
    assert_eq!(refused.to_string(), expected);
}

#[test]
fn a_header_that_lies_reserves_nothing() {
    let mut bytes = data("exr/half-zip.exr");
    // The data window is four corners, the last two the largest column and row.
    let name = b"dataWindow\0box2i\0";
    let at = bytes.windows(name.len()).position(|window| window == name);
    let at = at.unwrap() + name.len() + 4;
    bytes[at + 8..at + 12].copy_from_slice(&999_999_i32.to_le_bytes());
    let refused = decode_image(&bytes, &DecodeSettings::default()).unwrap_err();
    let expected = "says it has 1000000 x 36 pixels, more than the limit `pixels` = 33554432";
    assert_eq!(refused.to_string(), expected);

    let expected = "says it has 24 x 36 pixels, more than the limit `pixels` = 100";
    assert_eq!(refusal("half-zip", &at_most(100)), expected);
}

/// Each of these goes wrong in the plain form of the code; `docs/hard-cases.md` says how.
mod hard_cases {
    use super::*;

    /// NaN, inf, -inf, -0.25, 1e6, 6e4, 0 and -0 in the first row of each channel. As a half, 1e6
    /// is infinite.
    const FILES: [&str; 2] = ["exr/hard-float.exr", "exr/hard-half.exr"];

    /// The transfer function without a look at what goes in.
    fn naive_srgb(light: f64) -> f64 {
        1.055 * light.powf(1.0 / 2.4) - 0.055
    }

    #[test]
    fn exr_light_that_no_display_has_is_black_or_white_and_counted_but_for_zero_of_either_sign() {
        for (name, infinite, clipped) in [(FILES[0], 2, 2), (FILES[1], 3, 1)] {
            let Decoded { frame, light } = decoded(name);
            let expected = LightCounts {
                nan: 3,
                infinite: 3 * infinite,
                negative: 3,
                clipped: 3 * clipped,
            };
            assert_eq!(light, expected, "{name}");
            let shown = [0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0];
            let pixels = frame.data.as_chunks::<3>().0.iter();
            for (column, (pixel, value)) in pixels.zip(shown).enumerate() {
                let errors = pixel.map(|sample| (f64::from(sample) - value).abs());
                println!("{name}, column {column}: errors {errors:?}, bound {EXACT:.0e}");
                let is_exact = errors.iter().all(|error| *error <= EXACT);
                assert!(is_exact, "{name}: {column}");
            }
        }
        assert!(naive_srgb(f64::NAN).clamp(0.0, 1.0).is_nan());
        assert!(naive_srgb(f64::INFINITY).is_infinite());
        assert!(naive_srgb(-0.25).is_nan());
        assert!(naive_srgb(1e6) > 333.0 && naive_srgb(6e4) > 1.0);
    }

    #[test]
    fn exr_hard_pixels_leave_the_others_alone() {
        for name in FILES {
            let frame = decoded(name).frame;
            check(name, &frame, SIZE, EXACT, |x, y| {
                if y == 0 && x < 8 {
                    [0, 1, 2].map(|channel| f64::from(frame.data[x * 3 + channel]))
                } else {
                    rgb(x, y)
                }
            });
        }
    }

    #[test]
    fn exr_nan_and_infinity_are_refused_where_asked() {
        let reject = DecodeSettings {
            non_finite: NonFinite::Reject,
            ..DecodeSettings::default()
        };
        for (name, count) in FILES.into_iter().zip([6, 9]) {
            let refused = decoded_with(name, &reject).unwrap_err().to_string();
            let found = format!("has 3 NaN and {count} infinite samples");
            let expected = format!("{found}, and the policy is to reject them");
            assert_eq!(refused, expected);
        }
    }

    #[test]
    fn exr_missing_channel_is_named() {
        let expected = "has the channels G, R; expected R, G and B, or Y, or Y, RY and BY";
        assert_eq!(refusal("no-blue", &DecodeSettings::default()), expected);
    }

    /// Half-precision rounding inside OpenEXR's reader, taken through the steepest part of sRGB.
    const HALF_STEPS: f64 = 0.001;

    #[test]
    fn exr_subsampled_chroma_as_openexr_reads_it() {
        let rec_709 = reference("yc-zip");
        for compression in ["none", "rle", "zips", "zip", "piz", "pxr24"] {
            shows(&format!("yc-{compression}"), HALF_STEPS, &rec_709);
        }
        // Of other primaries.
        shows("yc-rec2020", HALF_STEPS, reference("yc-rec2020"));
    }

    #[test]
    fn exr_subsampled_chroma_under_a_lossy_compression_is_refused() {
        let expected =
            "uses a feature of EXR that is not read: subsampled channels under b44 compression";
        assert_eq!(refusal("yc-b44", &DecodeSettings::default()), expected);
    }

    #[test]
    fn exr_cut_at_any_byte_is_an_error() {
        for name in "half-zip half-piz tiled mipmap parts yc-zips deep-and-flat".split(' ') {
            cut_anywhere(&format!("exr/{name}.exr"));
        }
    }
}
