//! Embeddings of windows, against means of the last feature maps in f64.

use candle_core::{Device, Tensor};

use super::{calibrated, exact_features, of_images};
use crate::Error;
use crate::encoders::{Depths, Encoder, EncoderKind, Precision, WindowEmbeddings};
use crate::golden::{self, error, on_threads, uniform};

const SIZE: [usize; 2] = [147, 210];

/// `(height, width, 3)`, noise that grows brighter from row to row.
fn image([height, width]: [usize; 2]) -> Vec<f32> {
    let noise = uniform("windows.image", height * width * 3).into_iter();
    let brightness = |i: usize| (i + 1) as f64 / (height * width * 3) as f64;
    let value = |(i, u)| ((0.5 + 0.5 * u) * brightness(i)) as f32;
    noise.enumerate().map(value).collect()
}

/// With weights by the golden rule: seeded ones enlarge what bf16 rounds off.
fn encoder(kind: EncoderKind, precision: Precision) -> Encoder {
    let mut encoder = golden::encoder(kind);
    if precision == Precision::Int8 {
        encoder = calibrated(encoder);
    }
    encoder.with_precision(precision).unwrap()
}

/// The last feature map in f64, `(width, rows, columns)`.
fn last_map(encoder: &Encoder) -> Tensor {
    let shape = (1, SIZE[0], SIZE[1], 3);
    let image = Tensor::from_vec(image(SIZE), shape, &Device::Cpu).unwrap();
    let image = image.permute((0, 3, 1, 2)).unwrap();
    exact_features(encoder, &image).squeeze(0).unwrap()
}

/// The mean of a map over the cells with their centres in a window.
fn mean(map: &Tensor, start: [usize; 2], window: [usize; 2]) -> Vec<f64> {
    let (_, rows, columns) = map.dims3().unwrap();
    let inside = |axis: usize, count: usize| -> Tensor {
        let pixels = SIZE[axis] as f64 / count as f64;
        let (from, to) = (start[axis] as f64, (start[axis] + window[axis]) as f64);
        let centres = (0..count as u32).map(|cell| (f64::from(cell) + 0.5) * pixels);
        let cells = centres.zip(0_u32..).filter(|(c, _)| (from..to).contains(c));
        Tensor::from_iter(cells.map(|(_, cell)| cell), &Device::Cpu).unwrap()
    };
    let map = map.index_select(&inside(0, rows), 1).unwrap();
    let map = map.index_select(&inside(1, columns), 2).unwrap();
    map.mean((1, 2)).unwrap().to_vec1().unwrap()
}

fn windows(encoder: &Encoder, window: [usize; 2], stride: usize) -> WindowEmbeddings {
    let image = image(SIZE);
    encoder.embed_windows(&image, SIZE, window, stride).unwrap()
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

/// The largest error of the windows' embeddings, of the largest value; `map` is the last feature map in f64.
fn error_of(encoder: &Encoder, map: &Tensor) -> f64 {
    const WINDOW: [usize; 2] = [64, 81];
    const STRIDE: usize = 23;
    let found = windows(encoder, WINDOW, STRIDE);
    assert_eq!((found.rows, found.columns), (4, 6));
    let mut expected = Vec::new();
    for (at, centre) in found.centres.iter().enumerate() {
        let start = [at / 6 * STRIDE, at % 6 * STRIDE];
        assert_eq!(*centre, [start[0] as f64 + 32.0, start[1] as f64 + 40.5]);
        expected.extend(mean(map, start, WINDOW));
    }
    error(&wide(&found.embeddings), &expected)
}

#[test]
fn embeddings_are_means_of_the_last_feature_map() {
    for kind in of_images() {
        let encoder = encoder(kind, Precision::F32);
        let map = last_map(&encoder);
        for (precision, bound) in [(Precision::F32, 5e-6), (Precision::Bf16, 2e-2)] {
            let encoder = encoder.clone().with_precision(precision).unwrap();
            let found = error_of(&encoder, &map);
            println!("{kind}, {precision}: {found:.1e}, bound {bound:.0e}");
            assert!(found <= bound, "{kind}, {precision}: {found:.1e}");
        }
    }
}

#[test]
fn one_window_is_the_image() {
    for kind in of_images() {
        let encoder = encoder(kind, Precision::Int8);
        let encoder = encoder.with_depths(&Depths::All).unwrap();
        for precision in Precision::ALL {
            let encoder = encoder.clone().with_precision(precision).unwrap();
            let found = windows(&encoder, SIZE, 1);
            assert_eq!((found.rows, found.columns), (1, 1));
            assert_eq!(found.centres, [[73.5, 105.0]]);
            let expected = encoder.embed_pixels(&[&image(SIZE)], SIZE).unwrap();
            let found = error(&wide(&found.embeddings), &wide(&expected));
            println!("{kind}, {precision}: {found:.1e}");
            assert!(found <= 1e-6, "{kind}, {precision}: {found:.1e}");
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    for precision in Precision::ALL {
        let encoder = encoder(EncoderKind::EfficientNetLiteBody, precision);
        let on = |threads| on_threads(threads, || windows(&encoder, [48, 50], 9));
        let expected = on(1);
        assert_eq!(on(2), expected);
        assert_eq!(on(3), expected);
    }
}

#[test]
fn hard_cases() {
    let small = encoder(EncoderKind::EfficientNetLiteBody, Precision::F32);
    let squeezenet = encoder(EncoderKind::SqueezeNet1_0, Precision::F32);
    let size = [64, 96];
    let refused = |encoder: &Encoder, size: [usize; 2], window, stride, expected: &str| {
        let error = encoder.embed_windows(&image(size), size, window, stride);
        let error = error.unwrap_err();
        assert!(matches!(error, Error::Input(_)));
        assert!(error.to_string().contains(expected), "{error}");
    };
    let beyond = "[65, 96], expected 1 to [64, 96]";
    refused(&small, size, [65, 96], 1, beyond);
    refused(&small, size, [64, usize::MAX], 1, "expected 1 to [64, 96]");
    refused(&small, size, [0, 5], 1, "window: found [0, 5]");
    refused(&small, size, [64, 96], 0, "stride of windows: found 0");
    // A feature map of 2 rows and 3 columns.
    refused(&small, size, [31, 96], 1, "height 31, expected at least 32");
    refused(&small, size, [64, 31], 1, "width 31, expected at least 32");
    refused(&squeezenet, [6, 9], [6, 9], 1, "sides of at least 7");
    let misfit = small.embed_windows(&image(size), [96, 96], [64, 64], 1);
    golden::refused(misfit, "[96, 96]");
    let misfit = small.embed_windows(&[], [usize::MAX, 2], [1, 1], 1);
    assert!(misfit.is_err());
    // As small as they can be: one cell, one pixel, and a stride beyond the image.
    let of = |encoder: &Encoder, size, window, stride| {
        let found = encoder.embed_windows(&image(size), size, window, stride);
        let found = found.unwrap();
        assert!(found.embeddings.iter().all(|value| value.is_finite()));
        (found.rows, found.columns)
    };
    assert_eq!(of(&small, size, [32, 32], 32), (2, 3));
    assert_eq!(of(&small, size, [32, 32], usize::MAX), (1, 1));
    assert_eq!(of(&small, [1, 1], [1, 1], 1), (1, 1));
    assert_eq!(of(&squeezenet, [7, 500], [7, 60], 100), (1, 5));
}
