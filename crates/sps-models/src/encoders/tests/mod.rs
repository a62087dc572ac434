//! The reference path in f64, and networks on hard inputs.

mod hard_cases;
mod i3d;
mod int8;
mod networks;
mod training;
mod windows;

use candle_core::{DType, Device, Tensor, Var};
use sps_kernels::Normalisation;
use sps_kernels::simd::Level;

use super::plain::Plain;
use super::{Depths, Encoder, EncoderKind, Precision};
use crate::golden::{self, error, values};
use crate::weights::Weights;

/// The last feature map of a network in f64, `(n, width, rows, columns)`, by candle's operators, which
/// are held to PyTorch's below; of images as [`Encoder::embed`] takes them.
fn exact_features(encoder: &Encoder, images: &Tensor) -> Tensor {
    let double = |tensor: &Tensor| tensor.to_dtype(DType::F64).unwrap();
    let row = |row: [f32; 3]| {
        let row = Tensor::new(&row.map(f64::from), &Device::Cpu).unwrap();
        row.reshape((1, 3, 1, 1)).unwrap()
    };
    let tensors = encoder.weights().iter();
    let tensors = tensors.map(|(name, tensor)| (name.to_owned(), double(tensor)));
    let weights = Weights::sharing("f64", tensors);
    let Normalisation { mean, std } = encoder.network.normalisation;
    let images = double(images).broadcast_sub(&row(mean)).unwrap();
    let images = images.broadcast_div(&row(std)).unwrap();
    let net = Plain::new(&encoder.network, &weights);
    net.features(&images).unwrap().pop().unwrap()
}

/// The networks of images.
fn of_images() -> impl Iterator<Item = EncoderKind> {
    let all = EncoderKind::ALL.into_iter();
    all.filter(|kind| !kind.takes_sequences())
}

/// An encoder that can compute in int8.
fn calibrated(encoder: Encoder) -> Encoder {
    let images = golden::tensor("calibration", &[4, 3, 72, 72]);
    let images = (images.to_dtype(DType::F32).unwrap() * 0.5).unwrap();
    let images = (images + 0.5).unwrap();
    encoder.calibrated(&[&images]).unwrap()
}

/// The norm of the difference relative to that of what is expected.
fn relative(found: &Tensor, expected: &Tensor) -> f64 {
    let norm = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>().sqrt();
    let (found, expected) = (values(found), values(expected));
    let differences: Vec<f64> = found.iter().zip(&expected).map(|(f, e)| f - e).collect();
    norm(&differences) / norm(&expected)
}

/// Printed by the networks' authors and keepers, with the classifier, which is left out here:
/// table 2 of "Squeeze-and-Excitation Networks" (CVPR 2018) has 4.25 G for SE-ResNeXt-50,
/// torchvision's page of `squeezenet1_0` 0.82 G.
#[test]
fn multiply_adds_are_those_printed() {
    let of = |kind: EncoderKind| kind.multiply_adds([1, 224, 224]).unwrap() as f64;
    let paper = of(EncoderKind::SeResNext50) + 2048.0 * 1000.0;
    assert!((paper / 4.25e9 - 1.0).abs() < 0.01, "{paper:e}");
    let classifier = 13.0 * 13.0 * 512.0 * 1000.0;
    let squeezenet = of(EncoderKind::SqueezeNet1_0) + classifier;
    assert!((squeezenet / 0.82e9 - 1.0).abs() < 0.01, "{squeezenet:e}");
}

#[test]
fn an_image_too_small_to_embed_has_no_multiply_adds() {
    assert_eq!(EncoderKind::SqueezeNet1_0.multiply_adds([1, 6, 64]), None);
    assert!(
        EncoderKind::EfficientNetLiteBody
            .multiply_adds([1, 1, 1])
            .is_some()
    );
}

#[test]
fn an_image_whose_multiply_adds_no_number_holds_has_none() {
    for kind in EncoderKind::ALL {
        for size in [[1, usize::MAX, usize::MAX], [1, 1 << 32, 1 << 32]] {
            assert_eq!(kind.multiply_adds(size), None, "{kind}");
        }
    }
}

/// Without rounding, the composition that the kernels are measured against is PyTorch's network:
/// no gradient hangs on which side of zero a rectifier's input falls.
#[test]
fn plain_operators_in_f64() {
    let variables: Vec<(String, Var)> = EncoderKind::SeResNext50
        .specs()
        .iter()
        .map(|spec| {
            let exact = golden::weight(spec).to_dtype(DType::F64).unwrap();
            (spec.name.clone(), Var::from_tensor(&exact).unwrap())
        })
        .collect();
    let tensors = variables
        .iter()
        .map(|(name, variable)| (name.clone(), variable.as_tensor().clone()));
    let weights = Weights::sharing("the golden rule", tensors);
    let expected = golden::load("se_resnext50.safetensors");
    let f32_input = |name: &str, shape: &[usize]| {
        let tensor = golden::tensor(name, shape).to_dtype(DType::F32).unwrap();
        tensor.to_dtype(DType::F64).unwrap()
    };

    let images = f32_input("golden/train64", &[4, 3, 64, 64]);
    let network = EncoderKind::SeResNext50
        .network()
        .at(&Depths::Last)
        .unwrap();
    let net = Plain::training(&network, &weights);
    let embedding = net.embed(&images).unwrap();
    let found = error(&values(&embedding), &values(&expected["train64.embedding"]));
    assert!(found < 1e-11, "embedding {found:.1e}");

    let cotangent = f32_input("golden/train64.cotangent", embedding.dims());
    let loss = (embedding * cotangent).unwrap().mean_all().unwrap();
    let gradients = loss.backward().unwrap();
    let mut seen = 0;
    for (name, variable) in &variables {
        if let Some(expected) = expected.get(&format!("train64.grad.{name}")) {
            let found = relative(gradients.get(variable).unwrap(), expected);
            assert!(found < 1e-9, "gradient of {name} {found:.1e}");
            seen += 1;
        }
    }
    assert_eq!(seen, 8);
}

const SMALL_ONES: [EncoderKind; 3] = [
    EncoderKind::SeResNext50,
    EncoderKind::SqueezeNet1_0,
    EncoderKind::EfficientNetLiteBody,
];

/// One hash, one embedding to the last bit, whatever instructions the processor has.
#[test]
fn encoders_of_one_content_hash_embed_alike() {
    let images = golden::tensor("pixels", &[2, 3, 65, 40]).to_dtype(DType::F32);
    let images = images.unwrap();
    for kind in SMALL_ONES {
        let encoder = calibrated(Encoder::seeded(kind, 1).unwrap());
        for precision in Precision::ALL {
            let embed = || {
                let encoder = encoder.clone().with_precision(precision).unwrap();
                let embedding = encoder.embed_normalised(&images).unwrap();
                (encoder.content_hash(), embedding.to_vec2::<f32>().unwrap())
            };
            let (hash, embedding) = embed();
            Level::on_each(|level| {
                let (found_hash, found) = embed();
                let alike = (found_hash == hash, found == embedding);
                let case = format!("{kind} {precision} {level:?}: {alike:?}");
                assert!(matches!(alike, (true, true) | (false, _)), "{case}");
                println!("{case}");
            });
        }
    }
}

#[test]
fn pixels_embed_as_the_same_images_do() {
    let (count, height, width) = (3, 40, 33);
    let images = golden::tensor("pixels", &[count, 3, height, width]);
    let images = images.to_dtype(DType::F32).unwrap().abs().unwrap();
    let pixels = images.permute((0, 2, 3, 1)).unwrap().flatten_all().unwrap();
    let pixels: Vec<f32> = pixels.to_vec1().unwrap();
    for kind in SMALL_ONES {
        for precision in Precision::ALL {
            let encoder = calibrated(Encoder::seeded(kind, 1).unwrap());
            let encoder = encoder.with_precision(precision).unwrap();
            let expected = encoder.embed(&images).unwrap().flatten_all().unwrap();
            let pixels: Vec<&[f32]> = pixels.chunks_exact(3 * height * width).collect();
            let found = encoder.embed_pixels(&pixels, [height, width]).unwrap();
            assert_eq!(
                found,
                expected.to_vec1::<f32>().unwrap(),
                "{kind} {precision}"
            );
            assert!(encoder.embed_pixels(&[], [height, width]).is_err());
            for wrong in [[height, width + 1], [0, width], [usize::MAX; 2]] {
                assert!(encoder.embed_pixels(&pixels, wrong).is_err(), "{wrong:?}");
            }
        }
    }
}
