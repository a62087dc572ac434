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

/// Compares the image of a file with what is expected of each pixel.
fn shows(file: &str, bound: f64, expected: impl Fn(usize, usize) -> [f64; 3]) {
    check(file, &decoded(file).frame, SIZE, bound, expected);
}

fn grey(x: usize, y: usize) -> [f64; 3] {
    [eight(samples(x, y)[4]); 3]
}

#[test]
fn png_of_8_bits() {
    for (file, expected) in [
        ("png/rgb8.png", rgb as fn(usize, usize) -> [f64; 3]),
        ("png/rgb8-interlaced.png", rgb),
        ("png/grey8.png", grey),
    ] {
        shows(file, EXACT, expected);
        assert_eq!(decoded(file).light, LightCounts::default());
    }
}

#[test]
fn jpeg_of_each_kind() {
    for file in ["rgb", "progressive", "restarts"] {
        shows(&format!("jpeg/{file}.jpg"), LOSSY, rgb);
    }
    shows("jpeg/grey.jpg", LOSSY, grey);
    // Chroma at half resolution cannot follow a gradient to its corners.
    shows("jpeg/subsampled.jpg", 11.5 / 255.0, rgb);
}

#[test]
fn a_header_that_lies_reserves_nothing() {
    // The size of a PNG stands after its signature and the chunk's length and name.
    let mut png = data("png/rgb8.png");
    png[16..20].copy_from_slice(&2_000_000_000_u32.to_be_bytes());
    // The size of a JPEG stands in its frame segment, rows first.
    let mut jpeg = data("jpeg/rgb.jpg");
    let frame = jpeg.windows(2).position(|mark| mark == [0xff, 0xc0]);
    jpeg[frame.unwrap() + 5..][..4].fill(0xff);
    let refused = decode_image(&jpeg, &DecodeSettings::default()).unwrap_err();
    let expected = "says it has 65535 x 65535 pixels, more than the limit `pixels` = 33554432";
    assert_eq!(refused.to_string(), expected);
    assert!(decode_image(&png, &DecodeSettings::default()).is_err());

    for name in ["png/rgb8.png", "jpeg/rgb.jpg"] {
        let refused = decoded_with(name, &at_most(191)).unwrap_err();
        let too_many = matches!(refused, FrameErrorKind::TooManyPixels { .. });
        assert!(too_many, "{refused}");
        let expected = "says it has 16 x 12 pixels, more than the limit `pixels` = 191";
        assert_eq!(refused.to_string(), expected);
    }
}

#[test]
fn other_formats_are_named_by_their_first_bytes() {
    for (bytes, found) in [(&b"GIF89a"[..], "the bytes 47 49 46 38"), (b"", "nothing")] {
        let refused = decode_image(bytes, &DecodeSettings::default()).unwrap_err();
        let expected = format!("begins with {found}, which is no PNG, JPEG or EXR");
        assert_eq!(refused.to_string(), expected);
    }
}

/// Each of these goes wrong in the plain form of the code; `docs/hard-cases.md` says how.
mod hard_cases {
    use super::*;

    #[test]
    fn png_of_16_bits_keeps_them() {
        let of = |channel: usize, x, y| sixteen(samples(x, y)[channel], x, y);
        shows("png/grey16.png", EXACT, |x, y| [of(4, x, y); 3]);
        let (name, rgb) = ("png/rgb16.png", |x, y| [0, 1, 2].map(|c| of(c, x, y)));
        shows(name, EXACT, rgb);
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
            shows(&name, EXACT, expected);
            // Levels taken for those of 8 bits.
            let dark = |x: usize, _| [eight(x % (levels + 1)); 3];
            naive_misses(&name, SIZE, EXACT, dark, expected);
        }
    }

    #[test]
    fn png_palette_is_looked_up_and_its_alpha_shows_the_background() {
        let palette = |x: usize, _: usize| [16 * x, 255 - 16 * x, 7 * x].map(eight);
        shows("png/palette4.png", EXACT, palette);
        naive_misses("index as grey", SIZE, EXACT, |x, _| [eight(x); 3], palette);
        let over_white = |x, y| palette(x, y).map(|value| over(value, eight(17 * x)));
        shows("png/palette4-alpha.png", EXACT, over_white);
        naive_misses("alpha dropped", SIZE, EXACT, palette, over_white);
    }

    #[test]
    fn png_grey_level_declared_transparent_shows_the_background() {
        let expected = |x: usize, _| [if 16 * x == 32 { 1.0 } else { eight(16 * x) }; 3];
        shows("png/grey8-transparent.png", EXACT, expected);
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
                let [r, g, b, alpha, grey] = samples(x, y).map(|value| match bits {
                    8 => eight(value),
                    _ => sixteen(value, x, y),
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
    fn png_with_alpha_shows_the_background() {
        for bits in [8, 16] {
            check_alpha(&format!("png/grey-alpha{bits}.png"), bits, true);
            check_alpha(&format!("png/rgba{bits}.png"), bits, false);
        }
    }

    fn ink(x: usize, y: usize) -> [f64; 3] {
        rgb(x, y).map(|ink| (1.0 - ink) * (1.0 - eight(9 * y)))
    }

    #[test]
    fn jpeg_cmyk_and_ycck_become_light() {
        shows("jpeg/cmyk-adobe.jpg", LOSSY, ink);
        shows("jpeg/ycck.jpg", LOSSY, ink);
        let dropped = |x, y| rgb(x, y).map(|i| 1.0 - i);
        naive_misses("black ink dropped", SIZE, LOSSY, dropped, ink);
        let black = |y: usize| eight(9 * y);
        let sum = |x: usize, y: usize| rgb(x, y).map(|i| 1.0 - i - black(y));
        naive_misses("inks added up", SIZE, LOSSY, sum, ink);
    }

    #[test]
    fn jpeg_and_png_stand_upright() {
        for turn in 1..=8 {
            shows(&format!("jpeg/turned{turn}.jpg"), LOSSY, rgb);
        }
        shows("png/turned6.png", EXACT, rgb);
        // Left as stored, an image that is mirrored or upside down keeps its size and is wrong; one
        // on its side has another size.
        let (right, bottom) = (SIZE.0 - 1, SIZE.1 - 1);
        naive_misses("mirrored", SIZE, LOSSY, |x, y| rgb(right - x, y), rgb);
        naive_misses("upside down", SIZE, LOSSY, |x, y| rgb(x, bottom - y), rgb);
    }

    #[test]
    fn jpeg_with_stray_bytes_between_segments_is_read() {
        shows("jpeg/stray-bytes.jpg", LOSSY, rgb);
    }

    #[test]
    fn jpeg_or_png_cut_at_any_byte_is_an_error() {
        for name in "rgb progressive restarts stray-bytes cmyk-adobe turned6".split(' ') {
            cut_anywhere(&format!("jpeg/{name}.jpg"));
        }
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
