//! Networks in int8 beside themselves in f32, and what calibration must survive.

use candle_core::{Device, Tensor};
use sps_kernels::simd::Level;

use super::{SMALL_ONES, calibrated, of_images};
use crate::encoders::{Encoder, EncoderKind, Precision, TrainableEncoder, scales};
use crate::golden::{self, encoder, on_threads, refused, relative};
use crate::weights::Weights;

/// Images in 0..1 whose pixels have something to do with their neighbours.
fn images(name: &str, n: usize, height: usize, width: usize) -> Tensor {
    let coarse = golden::input(name, &[n, 3, height.div_ceil(8), width.div_ceil(8)]);
    let (h, w) = (height.next_multiple_of(8), width.next_multiple_of(8));
    let coarse = coarse.upsample_nearest2d(h, w).unwrap();
    let coarse = coarse.narrow(2, 0, height).unwrap();
    let coarse = coarse.narrow(3, 0, width).unwrap();
    let fine = golden::input(&format!("{name} fine"), &[n, 3, height, width]);
    let sum = ((coarse * 0.35).unwrap() + (fine * 0.1).unwrap()).unwrap();
    (sum + 0.5).unwrap().clamp(0.0, 1.0).unwrap()
}

fn int8(encoder: Encoder) -> Encoder {
    calibrated(encoder).with_precision(Precision::Int8).unwrap()
}

fn rows(encoder: &Encoder, images: &Tensor) -> Vec<Vec<f32>> {
    encoder.embed(images).unwrap().to_vec2().unwrap()
}

/// Images that calibration did not see.
#[test]
fn int8_stays_near_f32() {
    for kind in of_images() {
        let encoder = encoder(kind);
        let exact = encoder.embed(&images("others", 2, 97, 131)).unwrap();
        let encoder = encoder.calibrated(&[&images("seen", 4, 97, 131)]).unwrap();
        let encoder = encoder.with_precision(Precision::Int8).unwrap();
        let found = encoder.embed(&images("others", 2, 97, 131)).unwrap();
        let error = relative(&found, &exact);
        println!("{kind} in int8: relative error {error:.1e}");
        // The largest EfficientNets have 60 to 90 layers, of which no random weight makes less.
        let deep = encoder.network.layers.len() > 60;
        let bound = if deep { 3.0 * BOUND } else { BOUND };
        assert!(error < bound, "{kind}: {error:.1e}");
    }
}

/// How far embeddings by weights of the golden rule may move.
const BOUND: f64 = 5e-2;

#[test]
fn neither_neighbours_nor_threads_change_a_bit() {
    let images = images("batch", 5, 65, 40);
    for encoder in &*SMALL_ONES {
        let kind = encoder.kind();
        let encoder = encoder.clone().with_precision(Precision::Int8).unwrap();
        let together = rows(&encoder, &images);
        for (i, row) in together.iter().enumerate() {
            let alone = rows(&encoder, &images.narrow(0, i, 1).unwrap());
            assert_eq!(alone[0], *row, "{kind}");
        }
        for threads in [1, 2, 3] {
            let found = on_threads(threads, || rows(&encoder, &images));
            assert_eq!(found, together, "{kind} on {threads} threads");
        }
    }
}

/// Sums of whole numbers are exact, so that what follows is the same; gates, of f32, are not.
#[test]
fn every_level_gives_the_same_bits() {
    let images = images("levels", 1, 65, 40);
    for kind in [
        EncoderKind::SqueezeNet1_0,
        EncoderKind::EfficientNetLiteBody,
    ] {
        let encoder = int8(encoder(kind));
        let expected = rows(&encoder, &images);
        Level::on_each(|level| {
            let again = encoder.clone().with_precision(Precision::Int8).unwrap();
            assert_eq!(rows(&again, &images), expected, "{kind} {level:?}");
        });
    }
}

#[test]
fn scales_are_saved_and_loaded_with_the_weights() {
    let kind = EncoderKind::EfficientNetLiteBody;
    let images = images("saved", 2, 48, 48);
    let plain = encoder(kind);
    let encoder = int8(plain.clone());
    let bytes = encoder.weights().to_bytes().unwrap();
    let weights = Weights::from_bytes("a file", &bytes).unwrap();
    let loaded = Encoder::new(kind, weights).unwrap();
    // The scales change nothing in f32.
    assert_eq!(loaded.content_hash(), plain.content_hash());
    assert_eq!(rows(&loaded, &images), rows(&plain, &images));
    let loaded = loaded.with_precision(Precision::Int8).unwrap();
    assert_eq!(loaded.content_hash(), encoder.content_hash());
    assert_eq!(rows(&loaded, &images), rows(&encoder, &images));
    // Others are another encoder.
    let other = encoder.calibrated(&[&images]).unwrap();
    assert_eq!(other.precision(), Precision::Int8);
    assert_ne!(other.content_hash(), loaded.content_hash());
}

#[test]
fn training_leaves_no_scales() {
    let encoder = int8(encoder(EncoderKind::EfficientNetLiteBody));
    let trainable = TrainableEncoder::new(&encoder).unwrap();
    let mut names = trainable.variables().map(|(name, _)| name);
    assert!(names.all(|name| name != scales::TENSOR));
    let trained = trainable.encoder().unwrap();
    assert!(trained.with_precision(Precision::Int8).is_err());
}

#[test]
fn what_is_no_calibration_is_refused() {
    let kind = EncoderKind::EfficientNetLiteBody;
    let encoder = encoder(kind);
    let without = encoder.clone().with_precision(Precision::Int8);
    let expected = "int8 without scales of the feature maps, expected `Encoder::calibrated` before";
    refused(without, expected);
    let none = encoder.clone().calibrated(&[]);
    refused(none, "images to calibrate with: found none");
    let images = images("refused", 1, 32, 32);
    for wrong in [f32::NAN, f32::INFINITY] {
        let mut values = golden::numbers(&images);
        values[1000] = wrong;
        let wrong = Tensor::from_vec(values, images.dims(), &Device::Cpu).unwrap();
        refused(encoder.clone().calibrated(&[&images, &wrong]), "not finite");
    }
    let flat = images.flatten_all().unwrap();
    let of_flat = encoder.clone().calibrated(&[&flat]);
    refused(of_flat, "(n, 3, height, width)");

    let encoder = calibrated(encoder);
    let scales = encoder.weights().get(scales::TENSOR).unwrap().clone();
    let with = |scales: Tensor| {
        let mut weights = encoder.weights().clone();
        weights.replace(scales::TENSOR, scales);
        Encoder::new(kind, weights)
    };
    assert!(with(scales.clone()).is_ok());
    let short = scales.narrow(0, 1, scales.dims()[0] - 1).unwrap();
    refused(with(short), "scales for int8: found [");
    for wrong in [
        [0.0, 3.0],
        [-1.0, 3.0],
        [1.0, 3.5],
        [1.0, 256.0],
        [1.0, -1.0],
        [1e-40, 0.0],
    ] {
        let mut rows: Vec<Vec<f32>> = scales.to_vec2().unwrap();
        rows[3] = wrong.to_vec();
        let wrong = Tensor::new(rows, &Device::Cpu).unwrap();
        refused(with(wrong), "a finite step above 0");
    }
}

/// What calibration saw was of one value, and what comes later is not: nothing is divided by 0.
#[test]
fn calibration_by_images_of_one_value() {
    for encoder in &*SMALL_ONES {
        let kind = encoder.kind();
        for value in [0.0_f32, 0.5, 1e-30] {
            let flat = Tensor::full(value, (1, 3, 40, 40), &Device::Cpu).unwrap();
            let encoder = encoder.clone().calibrated(&[&flat]).unwrap();
            let encoder = encoder.with_precision(Precision::Int8).unwrap();
            for images in [flat, images("after", 1, 40, 40)] {
                let row = &rows(&encoder, &images)[0];
                assert!(row.iter().all(|v| v.is_finite()), "{kind} {value}");
            }
        }
    }
}

/// A map that is 0 everywhere, and channels without weights.
#[test]
fn weights_that_are_all_zero() {
    let kind = EncoderKind::SqueezeNet1_0;
    let mut weights = encoder(kind).weights().clone();
    for (name, kept) in [
        ("features.3.squeeze.weight", 1),
        ("features.4.squeeze.weight", 0),
    ] {
        let tensor = weights.get(name).unwrap();
        let outputs = tensor.dims()[0];
        let mask = (0..outputs).map(|channel| f32::from(u8::from(channel < kept * outputs / 2)));
        let mask = Tensor::from_iter(mask, &Device::Cpu).unwrap();
        let masked = tensor.broadcast_mul(&mask.reshape((outputs, 1, 1, 1)).unwrap());
        weights.replace(name, masked.unwrap());
    }
    let bias = "features.4.squeeze.bias";
    let zeros = weights.get(bias).unwrap().zeros_like().unwrap();
    weights.replace(bias, zeros);
    let encoder = Encoder::new(kind, weights).unwrap();
    let images = images("zeros", 1, 64, 64);
    let exact = encoder.embed(&images).unwrap();
    let error = relative(&int8(encoder).embed(&images).unwrap(), &exact);
    assert!(error < BOUND, "{error:.1e}");
}
