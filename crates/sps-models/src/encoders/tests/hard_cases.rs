//! Images and weights that a network must survive.

use std::sync::LazyLock;

use candle_core::{DType, Device, Tensor};
use half::f16;
use proptest::prelude::*;

use super::{SMALL_ONES, exact_features, of_images};
use crate::Error;
use crate::encoders::{Depths, Encoder, EncoderKind, Precision, TrainableEncoder};
use crate::golden::{bound, error, numbers, refused, values};
use crate::weights::Weights;

/// The paper's network as far as its second stage: batch norms, groups and gates, in seven blocks.
static GATED: LazyLock<Encoder> = LazyLock::new(|| {
    let depths = Depths::Named(vec!["stage-2".to_owned()]);
    let encoder = encoder(EncoderKind::SeResNext50).with_depths(&depths);
    encoder.unwrap()
});

fn encoder(kind: EncoderKind) -> Encoder {
    Encoder::seeded(kind, 1).unwrap()
}

fn filled(value: f32, shape: (usize, usize, usize, usize)) -> Tensor {
    Tensor::full(value, shape, &Device::Cpu).unwrap()
}

/// Values that differ from pixel to pixel.
fn textured(shape: (usize, usize, usize, usize)) -> Tensor {
    let (n, c, h, w) = shape;
    let value = |i: usize| ((i as u32).wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
    let values: Vec<f32> = (0..n * c * h * w).map(value).collect();
    Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
}

/// How far embeddings may be from those in f64, over the largest value, after [`LAYERS`] layers or fewer.
const BOUND: f64 = 5e-6;

/// The same without fused multiply-add, after [`LAYERS`] layers: as far as PyTorch's in f32
/// (`fixtures/golden/rounding_of_one_value.py`). After fewer it is smaller, but never below [`BOUND`].
const BOUND_NOT_FUSED: f64 = 1e-5;

/// As many as SE-ResNeXt-50 has. Rounding adds up and grows from layer to layer: with the square of their number.
const LAYERS: f64 = 54.0;

/// Each image less its own mean over its own spread, in f32.
fn naively_standardised(images: &Tensor) -> Vec<f32> {
    let images = numbers(images);
    let n = images.len() as f32;
    let mean = images.iter().sum::<f32>() / n;
    let spread = (images.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / n).sqrt();
    images.iter().map(|v| (v - mean) / spread).collect()
}

/// The kernels' embedding of each image is that of the network in f64.
fn agree(case: &str, encoder: &Encoder, images: &Tensor) {
    let found = values(&encoder.embed(images).unwrap());
    let exact = values(&exact_features(encoder, images).mean((2, 3)).unwrap());
    let width = encoder.width();
    let rows = found.chunks(width).zip(exact.chunks(width));
    let errors = rows.map(|(found, exact)| error(found, exact));
    let error = errors.fold(0.0, f64::max);
    let deep = encoder.network.layers.len() as f64 / LAYERS;
    let bound = (bound([BOUND, BOUND_NOT_FUSED]) * deep.powi(2)).max(BOUND);
    println!("{case}: error {error:.1e}, bound {bound:.0e}");
    assert!(error <= bound, "{case}");
}

#[test]
fn images_of_one_value() {
    for kind in of_images() {
        let encoder = encoder(kind);
        // A bright image first: nothing of it may be left in the memory that is used again.
        encoder.embed(&filled(1e3, (1, 3, 65, 80))).unwrap();
        let of_one_value = [0.0, 1.0, 0.5].map(|value| filled(value, (1, 3, 33, 40)));
        let images = Tensor::cat(&of_one_value, 0).unwrap();
        agree(&format!("{kind}, images of one value"), &encoder, &images);
        for value in [0.0, 1.0, 0.5] {
            let naive = naively_standardised(&filled(value, (1, 3, 32, 32)));
            assert!(naive[0].is_nan(), "the naive form");
        }
    }
}

/// Memory keeps the borders of maps from one pass to the next.
#[test]
fn what_was_embedded_before_changes_no_bit() {
    let images = textured((3, 3, 33, 40));
    for calibrated in &*SMALL_ONES {
        let kind = calibrated.kind();
        for precision in Precision::ALL {
            let encoder = || calibrated.clone().with_precision(precision).unwrap();
            let embed = |encoder: &Encoder| numbers(&encoder.embed(&images).unwrap());
            let (fresh, used) = (encoder(), encoder());
            used.embed(&filled(1.0, (5, 3, 65, 80))).unwrap();
            let first = embed(&used);
            used.embed(&filled(1.0, (1, 3, 40, 33))).unwrap();
            assert_eq!(first, embed(&used), "{kind}, {precision}");
            assert_eq!(first, embed(&fresh), "{kind}, {precision}");
        }
    }
}

#[test]
fn denormal_images() {
    for kind in of_images() {
        let encoder = encoder(kind);
        let images = [1e-40, 1e-42].map(|scale| (textured((1, 3, 17, 19)) * scale).unwrap());
        let both = Tensor::cat(&images, 0).unwrap();
        agree(&format!("{kind}, denormals"), &encoder, &both);
        for images in images {
            // The squares of denormals are zero.
            let naive = naively_standardised(&images);
            assert!(naive.iter().any(|v| !v.is_finite()), "the naive form");
        }
    }
}

#[test]
fn images_of_any_extent() {
    let small = &*GATED;
    for (height, width) in [(1, 1), (1, 2), (2, 1), (7, 5000), (3, 64), (65, 31)] {
        let case = format!("{height} x {width}");
        agree(&case, small, &textured((1, 3, height, width)));
    }
    let squeezenet = encoder(EncoderKind::SqueezeNet1_0);
    for (height, width) in [(7, 7), (7, 500), (8, 9), (47, 21)] {
        let case = format!("SqueezeNet, {height} x {width}");
        agree(&case, &squeezenet, &textured((3, 3, height, width)));
    }
}

#[test]
fn values_outside_of_what_a_camera_gives() {
    let small = &*GATED;
    for scale in [1e4, -1e4] {
        let images = (textured((2, 3, 17, 19)) * scale).unwrap();
        agree(&format!("values of {scale}"), small, &images);
    }
}

#[test]
fn images_that_cannot_be_embedded() {
    let small = &*GATED;
    let squeezenet = encoder(EncoderKind::SqueezeNet1_0);
    let ints = filled(0.0, (1, 3, 8, 8)).to_dtype(DType::U8).unwrap();
    let no_images = Tensor::zeros((0, 3, 8, 8), DType::F32, &Device::Cpu).unwrap();
    let no_pixels = Tensor::zeros((1, 3, 0, 8), DType::F32, &Device::Cpu).unwrap();
    for (encoder, images) in [
        (small, ints),
        (small, filled(0.0, (1, 4, 8, 8))),
        (small, no_images),
        (small, no_pixels),
        (&squeezenet, filled(0.0, (1, 3, 6, 8))),
    ] {
        let error = encoder.embed(&images).unwrap_err();
        assert!(matches!(error, Error::Input(input) if input.what == "images"));
    }
}

#[test]
fn training_on_images_of_one_value_is_finite() {
    for value in [0.0, 0.5, 1e4] {
        let mut trainable = TrainableEncoder::new(&GATED).unwrap();
        let images = filled(value, (2, 3, 33, 40));
        let embedding = trainable.forward(&images).unwrap();
        let loss = embedding.sqr().unwrap().mean_all().unwrap();
        let gradients = trainable.backward(&loss).unwrap();
        for (name, variable) in trainable.variables() {
            let gradient = numbers(gradients.get(variable).unwrap());
            assert!(gradient.iter().all(|g| g.is_finite()), "{name}");
        }
        trainable.weights().unwrap();
    }
}

#[test]
fn training_needs_two_numbers_a_channel() {
    for plain in [false, true] {
        let mut trainable = TrainableEncoder::new(&GATED).unwrap();
        if plain {
            trainable = trainable.with_plain_operators();
        }
        let error = trainable.forward(&textured((1, 3, 1, 1))).unwrap_err();
        assert_eq!(
            error.to_string(),
            "batch in training: found one number in each channel at layer0.bn1, expected at least \
             two: more images or larger ones"
        );
        assert!(trainable.forward(&textured((2, 3, 1, 1))).is_ok());
    }
}

/// By running statistics an image is embedded in training as in use, alone or in a batch, of whatever size; they stay
/// as they are. By the batch's own it is another.
#[test]
fn running_statistics_are_those_of_use() {
    let start = &*GATED;
    for shape in [(1, 3, 1, 1), (3, 3, 33, 40)] {
        let images = textured(shape);
        let run = |running| {
            let trainable = TrainableEncoder::new(start).unwrap();
            let mut trainable = trainable.with_running_statistics(running);
            let embeddings = trainable.forward(&images).map(|found| values(&found));
            (embeddings, trainable.weights().unwrap().to_bytes().unwrap())
        };
        let (found, after) = run(true);
        let off = error(&found.unwrap(), &values(&start.embed(&images).unwrap()));
        assert!(off <= BOUND, "{shape:?}: {off:.1e}");
        assert!(after == start.weights().to_bytes().unwrap(), "{shape:?}");
        assert!(shape.0 == 1 || run(false).1 != after);
    }
}

#[test]
fn training_on_odd_extents_agrees_with_plain_operators() {
    for shape in [(4, 3, 40, 37), (2, 3, 65, 70), (1, 3, 97, 131)] {
        let start = &*GATED;
        let images = textured(shape);
        let run = |mut trainable: TrainableEncoder| values(&trainable.forward(&images).unwrap());
        let new = || TrainableEncoder::new(start).unwrap();
        let (kernels, plain) = (run(new()), run(new().with_plain_operators()));
        let error = error(&kernels, &plain);
        assert!(error <= 1e-3, "{shape:?}: {error:.1e}");
    }
}

#[test]
fn half_weights_that_are_infinite_are_refused_by_name() {
    let broken = |value: f16| {
        let tensors = EncoderKind::SeResNext50.specs().into_iter().map(|spec| {
            let mut values = vec![f16::ONE; spec.shape.iter().product()];
            if spec.name == "layer2.0.conv2.weight" {
                values[5] = value;
            }
            let tensor = Tensor::from_vec(values, spec.shape, &Device::Cpu).unwrap();
            (spec.name, tensor)
        });
        Weights::from_tensors("half", tensors)
    };
    assert!(broken(f16::MAX).is_ok());
    for value in [f16::INFINITY, f16::NEG_INFINITY, f16::NAN] {
        let expected = format!("tensor \"layer2.0.conv2.weight\" holds {value} at flat index 5,");
        refused(broken(value), &expected);
        // Let in, a black pixel is enough.
        assert!((0.0 * value.to_f32()).is_nan(), "the naive form");
    }
}

/// One image embeds as in any batch. By the statistics of its batch it would not.
#[test]
fn a_batch_of_one() {
    let images = textured((4, 3, 33, 40));
    let first = images.narrow(0, 0, 1).unwrap();
    let small = &*GATED;
    agree("batch of one", small, &first);
    let together = small.embed(&images).unwrap().narrow(0, 0, 1).unwrap();
    assert_eq!(numbers(&small.embed(&first).unwrap()), numbers(&together));

    let in_training = |images: &Tensor| {
        let mut trainable = TrainableEncoder::new(small).unwrap();
        values(&trainable.forward(images).unwrap().narrow(0, 0, 1).unwrap())
    };
    let naive = error(&in_training(&first), &in_training(&images));
    println!("batch of one: naive form {naive:.1e}");
    assert!(naive > BOUND, "the naive form");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// An image's embedding does not hang on its neighbours in the batch, to the last bit.
    #[test]
    fn an_image_alone_embeds_as_in_a_batch(n in 2_usize..6, h in 1_usize..40, w in 1_usize..40) {
        let small = &*GATED;
        let images = textured((n, 3, h, w));
        let together = small.embed(&images).unwrap();
        for i in 0..n {
            let alone = small.embed(&images.narrow(0, i, 1).unwrap()).unwrap();
            let row = together.narrow(0, i, 1).unwrap();
            prop_assert_eq!(numbers(&alone), numbers(&row));
        }
    }
}
