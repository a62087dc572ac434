//! PNG and JPEG files of other encoders (`data/make_images.py`, `data/make_ycck.c`), against the
//! formulas of their content.

use crate::common::{at_most, check, cut_anywhere, data, decoded, decoded_with, naive_misses};
use sps_dataset::{DecodeSettings, FrameErrorKind, LightCounts, decode_image};

const SIZE: (usize, usize) = (16, 12);

/// Single precision.
const EXACT: f64 = 1e-6;

/// JPEG at quality 98 rounds its coefficients, which puts the corners of these gradients two levels
/// off.
const LOSSY: f64 = 2.5 / 255.0;

/// The samples of `make_images.py` at 8 bits: R, G, B, alpha, grey.
fn samples(x: usize, y: usize) -> [usize; 5] {
    [16 * x, 20 * y, (x + y) * 9, 17 * x, 16 * x + y]
}

fn eight(value: usize) -> f64 {
    value as f64 / 255.0
}

fn sixteen(value: usize, x: usize, y: usize) -> f64 {
    (257 * value + x + y).min(65535) as f64 / 65535.0
}

fn rgb(x: usize, y: usize) -> [f64; 3] {
    let [r, g, b, _, _] = samples(x, y);
    [r, g, b].map(eight)
}

/// Over white.
fn over(value: f64, alpha: f64) -> f64 {
    value * alpha + 1.0 - alpha
}

#[test]
fn png_of_8_bits() {
    let exact = |name: &str, expected: &dyn Fn(usize, usize) -> [f64; 3]| {
        let decoded = decoded(name);
        check(name, &decoded.frame, SIZE, EXACT, expected);
        assert_eq!(decoded.light, LightCounts::default());
    };
    exact("png/rgb8.png", &rgb);
    exact("png/rgb8-interlaced.png", &rgb);
    exact("png/grey8.png", &|x, y| [eight(samples(x, y)[4]); 3]);
}

#[test]
fn jpeg_of_each_kind() {
    for name in ["rgb", "progressive", "restarts"] {
        let name = format!("jpeg/{name}.jpg");
        check(&name, &decoded(&name).frame, SIZE, LOSSY, rgb);
    }
    let grey = |x, y| [eight(samples(x, y)[4]); 3];
    check("grey", &decoded("jpeg/grey.jpg").frame, SIZE, LOSSY, grey);
    // Chroma at half resolution cannot follow a gradient to its corners.
    check(
        "4:2:0",
        &decoded("jpeg/subsampled.jpg").frame,
        SIZE,
        11.5 / 255.0,
        rgb,
    );
}

#[test]
fn a_header_that_lies_reserves_nothing() {
    // The size of a PNG stands after its signature and the chunk's length and name.
    let mut png = data("png/rgb8.png");
    png[16..20].copy_from_slice(&2_000_000_000_u32.to_be_bytes());
    // The size of a JPEG stands in its frame segment, rows first.
    let mut jpeg = data("jpeg/rgb.jpg");
    let frame = jpeg
        .windows(2)
        .position(|mark| mark == [0xff, 0xc0])
        .unwrap();
    jpeg[frame + 5..frame + 9].fill(0xff);
    let refused = decode_image(&jpeg, &DecodeSettings::default()).unwrap_err();
    let expected = "says it has 65535 x 65535 pixels, more than the limit `pixels` = 33554432";
    assert_eq!(refused.to_string(), expected);
    assert!(decode_image(&png, &DecodeSettings::default()).is_err());

    let small = at_most(191);
    for name in ["png/rgb8.png", "jpeg/rgb.jpg"] {
        let refused = decoded_with(name, &small).unwrap_err();
        let too_many = matches!(
            refused,
            FrameErrorKind::TooManyPixels {
                width: 16,
                height: 12,
                ..
            }
        );
        assert!(too_many, "{refused}");
    }
}

#[test]
fn other_formats_are_named_by_their_first_bytes() {
    let refusal = |bytes: &[u8]| {
        decode_image(bytes, &DecodeSettings::default())
            .unwrap_err()
            .to_string()
    };
    assert_eq!(
        refusal(b"GIF89a"),
        "begins with the bytes 47 49 46 38, which is no PNG, JPEG or EXR"
    );
    assert_eq!(
        refusal(b""),
        "begins with nothing, which is no PNG, JPEG or EXR"
    );
}

/// Each of these goes wrong in the plain form of the code; `docs/hard-cases.md` says how.
mod hard_cases {
    use super::*;

    #[test]
    fn png_of_16_bits_keeps_them() {
        let name = "png/grey16.png";
        let grey = |x, y| [sixteen(samples(x, y)[4], x, y); 3];
        check(name, &decoded(name).frame, SIZE, EXACT, grey);
        let name = "png/rgb16.png";
        let rgb = |x, y| [0, 1, 2].map(|channel| sixteen(samples(x, y)[channel], x, y));
        check(name, &decoded(name).frame, SIZE, EXACT, rgb);
        // The upper byte alone.
        let upper = |v: f64| eight((v * 65535.0).round() as usize >> 8);
        naive_misses(name, SIZE, EXACT, |x, y| rgb(x, y).map(upper), rgb);
    }

    #[test]
    fn png_of_1_2_and_4_bits_reaches_white() {
        for bits in [1, 2, 4] {
            let name = format!("png/grey{bits}.png");
            let levels = (1_usize << bits) - 1;
            let expected = |x: usize, _| [(x % (levels + 1)) as f64 / levels as f64; 3];
            check(&name, &decoded(&name).frame, SIZE, EXACT, expected);
            // Levels taken for those of 8 bits.
            let dark = |x: usize, _| [eight(x % (levels + 1)); 3];
            naive_misses(&name, SIZE, EXACT, dark, expected);
        }
    }

    fn palette(x: usize, _: usize) -> [f64; 3] {
        [16 * x, 255 - 16 * x, 7 * x].map(eight)
    }

    #[test]
    fn png_palette_is_looked_up() {
        check(
            "palette",
            &decoded("png/palette4.png").frame,
            SIZE,
            EXACT,
            palette,
        );
        naive_misses("index as grey", SIZE, EXACT, |x, _| [eight(x); 3], palette);
    }

    #[test]
    fn png_palette_with_alpha_shows_the_background() {
        let over_white = |x, y| palette(x, y).map(|value| over(value, eight(17 * x)));
        check(
            "alpha",
            &decoded("png/palette4-alpha.png").frame,
            SIZE,
            EXACT,
            over_white,
        );
        naive_misses("alpha dropped", SIZE, EXACT, palette, over_white);
    }

    #[test]
    fn png_grey_level_declared_transparent_shows_the_background() {
        let expected = |x: usize, _| [if 16 * x == 32 { 1.0 } else { eight(16 * x) }; 3];
        let name = "png/grey8-transparent.png";
        check(name, &decoded(name).frame, SIZE, EXACT, expected);
        let shown = |x: usize, _| [eight(16 * x); 3];
        naive_misses("level shown", SIZE, EXACT, shown, expected);
    }

    /// Over each of three backgrounds.
    fn check_alpha(name: &str, bits: usize, is_grey: bool) {
        for background in [1.0_f32, 0.0, 0.25] {
            let settings = DecodeSettings {
                background: [background; 3],
                ..DecodeSettings::default()
            };
            let parts = |x, y| {
                let [r, g, b, alpha, grey] = samples(x, y).map(|value| {
                    if bits == 8 {
                        eight(value)
                    } else {
                        sixteen(value, x, y)
                    }
                });
                (if is_grey { [grey; 3] } else { [r, g, b] }, alpha)
            };
            let expected = |x, y| {
                let (rgb, alpha) = parts(x, y);
                rgb.map(|value| value * alpha + f64::from(background) * (1.0 - alpha))
            };
            let decoded = decoded_with(name, &settings).unwrap();
            check(name, &decoded.frame, SIZE, EXACT, expected);
            naive_misses("alpha dropped", SIZE, EXACT, |x, y| parts(x, y).0, expected);
        }
    }

    #[test]
    fn png_grey_with_alpha_shows_the_background() {
        check_alpha("png/grey-alpha8.png", 8, true);
        check_alpha("png/grey-alpha16.png", 16, true);
    }

    #[test]
    fn png_rgb_with_alpha_shows_the_background() {
        check_alpha("png/rgba8.png", 8, false);
        check_alpha("png/rgba16.png", 16, false);
    }

    fn ink(x: usize, y: usize) -> [f64; 3] {
        rgb(x, y).map(|ink| (1.0 - ink) * (1.0 - eight(9 * y)))
    }

    #[test]
    fn jpeg_cmyk_becomes_light() {
        check(
            "cmyk",
            &decoded("jpeg/cmyk-adobe.jpg").frame,
            SIZE,
            LOSSY,
            ink,
        );
        naive_misses(
            "black ink dropped",
            SIZE,
            LOSSY,
            |x, y| rgb(x, y).map(|i| 1.0 - i),
            ink,
        );
        let black = |y: usize| eight(9 * y);
        let sum = |x: usize, y: usize| rgb(x, y).map(|i| 1.0 - i - black(y));
        naive_misses("inks added up", SIZE, LOSSY, sum, ink);
    }

    #[test]
    fn jpeg_ycck_becomes_light() {
        check("ycck", &decoded("jpeg/ycck.jpg").frame, SIZE, LOSSY, ink);
    }

    #[test]
    fn jpeg_and_png_stand_upright() {
        for turn in 1..=8 {
            let name = format!("jpeg/turned{turn}.jpg");
            check(&name, &decoded(&name).frame, SIZE, LOSSY, rgb);
        }
        check("png", &decoded("png/turned6.png").frame, SIZE, EXACT, rgb);
        // Left as stored, an image that is mirrored or upside down keeps its size and is wrong; one
        // on its side has another size.
        let (right, bottom) = (SIZE.0 - 1, SIZE.1 - 1);
        naive_misses("mirrored", SIZE, LOSSY, |x, y| rgb(right - x, y), rgb);
        naive_misses("upside down", SIZE, LOSSY, |x, y| rgb(x, bottom - y), rgb);
    }

    #[test]
    fn jpeg_with_stray_bytes_between_segments_is_read() {
        check(
            "stray",
            &decoded("jpeg/stray-bytes.jpg").frame,
            SIZE,
            LOSSY,
            rgb,
        );
    }

    #[test]
    fn jpeg_cut_at_any_byte_is_an_error() {
        for name in "rgb progressive restarts stray-bytes cmyk-adobe turned6".split(' ') {
            cut_anywhere(&format!("jpeg/{name}.jpg"));
        }
    }

    #[test]
    fn png_cut_at_any_byte_is_an_error() {
        for name in ["rgb8", "rgb8-interlaced", "palette4-alpha", "turned6"] {
            cut_anywhere(&format!("png/{name}.png"));
        }
    }

    #[test]
    fn png_with_any_bit_flipped_is_an_error() {
        let bytes = data("png/rgb8.png");
        for bit in 0..bytes.len() * 8 {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            let decoded = decode_image(&flipped, &DecodeSettings::default());
            assert!(decoded.is_err(), "bit {bit}");
        }
    }
}
