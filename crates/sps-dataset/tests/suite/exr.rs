//! EXR files that OpenEXR wrote (`data/make_exr.cpp`), against the formulas of their content.

use crate::common::{at_most, check, cut_anywhere, data, decoded, decoded_with, srgb};
use sps_dataset::{DecodeSettings, FrameErrorKind, LightCounts, NonFinite, decode_image};

const SIZE: (usize, usize) = (24, 36);

/// Far below a step of 8 bits (0.004); a single-precision power is good to about 1e-7.
const EXACT: f64 = 1e-6;

fn rgb(x: usize, y: usize) -> [f64; 3] {
    let (x, y) = (x as f64, y as f64);
    [(x + 1.0) / 32.0, (y + 1.0) / 64.0, x * y / 1024.0].map(srgb)
}

fn grey(x: usize, y: usize) -> [f64; 3] {
    [srgb((x + y) as f64 / 64.0); 3]
}

#[test]
fn every_lossless_compression_and_type() {
    for compression in ["none", "rle", "zips", "zip", "piz", "pxr24"] {
        for kind in ["half", "float"] {
            let name = format!("exr/{kind}-{compression}.exr");
            let decoded = decoded(&name);
            check(&name, &decoded.frame, SIZE, EXACT, rgb);
            assert_eq!(decoded.light, LightCounts::default(), "{name}");
        }
    }
    for name in ["exr/mixed.exr", "exr/decreasing.exr", "exr/offset.exr"] {
        check(name, &decoded(name).frame, SIZE, EXACT, rgb);
    }
}

/// What OpenEXR's own reader made of a file.
fn reference(name: &str) -> impl Fn(usize, usize) -> [f64; 3] {
    let bytes = data(name);
    let floats = bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|&float| f32::from_le_bytes(float));
    let floats: Vec<f64> = floats.map(f64::from).collect();
    move |x, y| [0, 1, 2].map(|channel| srgb(floats[(y * SIZE.0 + x) * 3 + channel]))
}

#[test]
fn lossy_compressions_as_openexr_reads_them() {
    check(
        "b44",
        &decoded("exr/half-b44.exr").frame,
        SIZE,
        EXACT,
        reference("exr/half-b44.f32"),
    );
    check(
        "dwaa",
        &decoded("exr/half-dwaa.exr").frame,
        SIZE,
        EXACT,
        reference("exr/half-dwaa.f32"),
    );
}

#[test]
fn unsigned_integers_are_light_as_they_stand() {
    for name in ["exr/uint.exr", "exr/uint-pxr24.exr"] {
        let square = |step: usize, x: usize, y: usize| ((x / step + y / step) % 2) as f64;
        let expected = |x, y| [1, 2, 4].map(|step| square(step, x, y));
        check(name, &decoded(name).frame, SIZE, EXACT, expected);
    }
}

#[test]
fn tiles_at_full_resolution_only() {
    for name in ["exr/tiled.exr", "exr/mipmap.exr", "exr/ripmap.exr"] {
        check(name, &decoded(name).frame, SIZE, EXACT, rgb);
    }
}

#[test]
fn luminance_alone_is_grey() {
    check("grey", &decoded("exr/grey.exr").frame, SIZE, EXACT, grey);
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
    check("parts", &decoded("exr/parts.exr").frame, SIZE, EXACT, rgb);
    check(
        "deep",
        &decoded("exr/deep-and-flat.exr").frame,
        SIZE,
        EXACT,
        rgb,
    );
    check("layer", &decoded("exr/layer.exr").frame, SIZE, EXACT, rgb);
    let named = |file, name| decoded_with(file, &layer(name)).unwrap().frame;
    check(
        "beauty",
        &named("exr/parts.exr", "beauty"),
        SIZE,
        EXACT,
        rgb,
    );
    check("grey", &named("exr/parts.exr", "grey"), SIZE, EXACT, grey);
    check("left", &named("exr/layers.exr", "left"), SIZE, EXACT, rgb);
    check(
        "right",
        &named("exr/layers.exr", "right"),
        SIZE,
        EXACT,
        grey,
    );
}

fn refusal(name: &str, settings: &DecodeSettings) -> String {
    decoded_with(name, settings).unwrap_err().to_string()
}

#[test]
fn what_is_missing_or_ambiguous_is_named() {
    let any = DecodeSettings::default();
    assert_eq!(
        refusal("exr/layers.exr", &any),
        "has the channels left.B, left.G, left.R, right.Y; expected `exr-layer` to say which of \
         `left`, `right`"
    );
    assert_eq!(
        refusal("exr/parts.exr", &layer("buty")),
        "has the channels Z, B, G, R, Y; expected the layer `buty` to be one of `beauty`, `grey`"
    );
}

#[test]
fn exposure_brightens_before_clipping() {
    let settings = DecodeSettings {
        exposure_stops: 2.0,
        ..DecodeSettings::default()
    };
    let decoded = decoded_with("exr/half-zip.exr", &settings).unwrap();
    let light = |x: usize, y: usize| {
        let (x, y) = (x as f64, y as f64);
        [(x + 1.0) / 32.0, (y + 1.0) / 64.0, x * y / 1024.0].map(|light| light * 4.0)
    };
    check("exposed", &decoded.frame, SIZE, EXACT, |x, y| {
        light(x, y).map(srgb)
    });
    let pixels = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| light(x, y)));
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
    let at = bytes
        .windows(name.len())
        .position(|window| window == name)
        .unwrap()
        + name.len()
        + 4;
    bytes[at + 8..at + 12].copy_from_slice(&999_999_i32.to_le_bytes());
    let refused = decode_image(&bytes, &DecodeSettings::default()).unwrap_err();
    let expected = "says it has 1000000 x 36 pixels, more than the limit `pixels` = 33554432";
    assert_eq!(refused.to_string(), expected);

    let small = at_most(100);
    let refused = decoded_with("exr/half-zip.exr", &small).unwrap_err();
    assert!(matches!(
        refused,
        FrameErrorKind::TooManyPixels {
            width: 24,
            height: 36,
            limit: 100
        }
    ));
}

/// Each of these goes wrong in the plain form of the code; `docs/hard-cases.md` says how.
mod hard_cases {
    use super::*;

    /// NaN, inf, -inf, -0.25, 1e6, 6e4, 0 and -0 in the first row of each channel. As a half, 1e6
    /// is infinite.
    const FILES: [&str; 2] = ["exr/hard-float.exr", "exr/hard-half.exr"];

    /// Checks the pixels of those columns and leaves the counts to the caller.
    fn shown(name: &str, columns: std::ops::Range<usize>, value: f64) -> LightCounts {
        let decoded = decoded(name);
        let pixels = &decoded.frame.data[columns.start * 3..columns.end * 3];
        let errors = pixels
            .iter()
            .map(|&sample| (f64::from(sample) - value).abs());
        assert!(
            errors.clone().all(|error| error <= EXACT),
            "{name}: {columns:?}"
        );
        let error = errors.fold(0.0, f64::max);
        println!("{name} {columns:?}: error {error:.1e}, bound {EXACT:.0e}");
        decoded.light
    }

    /// The transfer function without a look at what goes in.
    fn naive_srgb(light: f64) -> f64 {
        1.055 * light.powf(1.0 / 2.4) - 0.055
    }

    #[test]
    fn exr_nan_is_black_and_counted() {
        for name in FILES {
            assert_eq!(shown(name, 0..1, 0.0).nan, 3, "{name}");
        }
        assert!(naive_srgb(f64::NAN).clamp(0.0, 1.0).is_nan());
    }

    #[test]
    fn exr_infinity_is_white_or_black_and_counted() {
        for (name, infinite) in FILES.into_iter().zip([2, 3]) {
            shown(name, 1..2, 1.0);
            assert_eq!(shown(name, 2..3, 0.0).infinite, 3 * infinite, "{name}");
        }
        assert!(naive_srgb(f64::INFINITY).is_infinite());
    }

    #[test]
    fn exr_negative_light_is_black_and_counted() {
        for name in FILES {
            assert_eq!(shown(name, 3..4, 0.0).negative, 3, "{name}");
        }
        assert!(naive_srgb(-0.25).is_nan());
    }

    #[test]
    fn exr_highlights_of_a_million_clip_and_are_counted() {
        for (name, clipped) in FILES.into_iter().zip([2, 1]) {
            assert_eq!(shown(name, 4..6, 1.0).clipped, 3 * clipped, "{name}");
        }
        assert!(naive_srgb(1e6) > 333.0 && naive_srgb(6e4) > 1.0);
    }

    #[test]
    fn exr_zero_of_either_sign_is_black_and_not_counted() {
        for name in FILES {
            let light = shown(name, 6..8, 0.0);
            assert_eq!(
                light.nan + light.infinite + light.negative + light.clipped,
                18,
                "{name}"
            );
        }
    }

    #[test]
    fn exr_hard_pixels_leave_the_others_alone() {
        for name in FILES {
            let frame = decoded(name).frame;
            check(name, &frame, SIZE, EXACT, |x, y| {
                let hard = y == 0 && x < 8;
                let at = x * 3..x * 3 + 3;
                if hard {
                    [0, 1, 2].map(|c| f64::from(frame.data[at.clone()][c]))
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
            let refused = decoded_with(name, &reject).unwrap_err();
            let counted = matches!(refused, FrameErrorKind::NonFinite { nan: 3, infinite } if infinite == count);
            assert!(counted, "{name}: {refused}");
        }
    }

    #[test]
    fn exr_missing_channel_is_named() {
        assert_eq!(
            refusal("exr/no-blue.exr", &DecodeSettings::default()),
            "has the channels G, R; expected R, G and B, or Y, or Y, RY and BY"
        );
    }

    /// Half-precision rounding inside OpenEXR's reader, taken through the steepest part of sRGB.
    const HALF_STEPS: f64 = 0.001;

    #[test]
    fn exr_subsampled_chroma_as_openexr_reads_it() {
        let rec_709 = reference("exr/yc-zip.f32");
        for compression in ["none", "rle", "zips", "zip", "piz", "pxr24"] {
            let name = format!("exr/yc-{compression}.exr");
            check(&name, &decoded(&name).frame, SIZE, HALF_STEPS, &rec_709);
        }
    }

    #[test]
    fn exr_chroma_of_other_primaries_as_openexr_reads_it() {
        let rec_2020 = reference("exr/yc-rec2020.f32");
        check(
            "2020",
            &decoded("exr/yc-rec2020.exr").frame,
            SIZE,
            HALF_STEPS,
            rec_2020,
        );
    }

    #[test]
    fn exr_subsampled_chroma_under_a_lossy_compression_is_refused() {
        assert_eq!(
            refusal("exr/yc-b44.exr", &DecodeSettings::default()),
            "uses a feature of EXR that is not read: subsampled channels under b44 compression"
        );
    }

    #[test]
    fn exr_cut_at_any_byte_is_an_error() {
        for name in "half-zip half-piz tiled mipmap parts yc-zips deep-and-flat".split(' ') {
            cut_anywhere(&format!("exr/{name}.exr"));
        }
    }
}
