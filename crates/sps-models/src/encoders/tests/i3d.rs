//! I3D against PyTorch's in f64 (`fixtures/golden/make_i3d_golden.py`), and what it refuses.

use candle_core::{DType, Device, Tensor};

use super::{embed_normalised, pass};
use crate::Error;
use crate::encoders::{Encoder, EncoderKind, Precision, TrainableEncoder};
use crate::golden::{self, norm, relative, values};

fn encoder() -> Encoder {
    golden::encoder(EncoderKind::I3d)
}

fn seeded() -> Encoder {
    Encoder::seeded(EncoderKind::I3d, 1).unwrap()
}

fn input(name: &str, shape: &[usize]) -> Tensor {
    golden::input(&format!("golden/i3d.{name}"), shape)
}

#[test]
fn embeds_as_pytorch_does() {
    let encoder = encoder();
    let expected = golden::load("i3d.safetensors");
    for (name, shape) in [
        ("even", [2, 3, 8, 32, 48]),
        ("odd", [1, 3, 5, 37, 29]),
        ("one", [1, 3, 1, 1, 1]),
    ] {
        let found = embed_normalised(&encoder, &input(name, &shape));
        let found = relative(&found, &expected[&format!("{name}.embedding")]);
        assert!(found < 1e-5, "{name}: {found:.1e}");
    }
}

/// Embedding, every gradient's norm, some whole gradients and running statistics of a pass in
/// training.
#[test]
fn trains_as_pytorch_does() {
    let expected = golden::load("i3d_training.safetensors");
    for checkpointing in [false, true] {
        let encoder = TrainableEncoder::new(&encoder()).unwrap();
        let mut encoder = encoder.with_checkpointing(checkpointing);
        let images = input("train.1", &[3, 3, 4, 40, 40]);
        let (embeddings, _, gradients) = pass(&mut encoder, &images, "golden/i3d.cotangent");
        let found = relative(&embeddings, &expected["embedding"]);
        assert!(found < 1e-4, "embedding: {found:.1e}");

        let mut norms = Vec::new();
        let mut whole = 0;
        for (name, gradient) in &gradients {
            norms.push(norm(&values(gradient)));
            if let Some(expected) = expected.get(&format!("gradient.{name}")) {
                let found = relative(gradient, expected);
                println!("gradient of {name}: {found:.1e}");
                assert!(found < 1e-3, "gradient of {name}: {found:.1e}");
                whole += 1;
            }
        }
        assert_eq!(whole, 4);
        let expected_norms = values(&expected["norms"]);
        let errors = norms.iter().zip(&expected_norms);
        let worst = errors.map(|(f, e)| (f - e).abs() / e).fold(0.0, f64::max);
        println!("norms of {} gradients: {worst:.1e}", norms.len());
        assert_eq!(norms.len(), expected_norms.len());
        assert!(worst < 1e-3, "norms of gradients: {worst:.1e}");

        let weights = encoder.weights().unwrap();
        let found = weights.get("Mixed_4c.b1b.bn.running_var").unwrap();
        let found = relative(found, &expected["running_var"]);
        assert!(found < 1e-5, "running variance: {found:.1e}");
    }
}

/// What is computed in fewer bits stays near f32, of sequences that calibration did not see.
#[test]
fn fewer_bits_stay_near() {
    let sequences = |name| (input(name, &[2, 3, 6, 40, 33]) * 0.5).unwrap() + 0.5;
    let seen = sequences("calibration").unwrap();
    let encoder = encoder().calibrated(&[&seen]).unwrap();
    let others = sequences("others").unwrap();
    let exact = encoder.embed(&others).unwrap();
    for (precision, bound) in [(Precision::Bf16, 1e-2), (Precision::Int8, 5e-2)] {
        let encoder = encoder.clone().with_precision(precision).unwrap();
        let found = relative(&encoder.embed(&others).unwrap(), &exact);
        println!("{precision}: {found:.1e}");
        assert!(found < bound, "{precision}: {found:.1e}");
    }
}

#[test]
fn the_classifier_may_be_in_the_file() {
    let mut weights = golden::weights(EncoderKind::I3d, str::to_owned);
    let classifier = Tensor::zeros((400, 1024, 1, 1, 1), DType::F32, &Device::Cpu).unwrap();
    weights.replace("logits.conv3d.weight", classifier);
    assert!(Encoder::new(EncoderKind::I3d, weights.clone()).is_ok());
    weights.remove("Mixed_4c.b2b.bn.bias").unwrap();
    let error = Encoder::new(EncoderKind::I3d, weights).unwrap_err();
    let expected = "the golden rule: tensor \"Mixed_4c.b2b.bn.bias\" of shape [64] is missing";
    assert_eq!(error.to_string(), expected);
}

mod hard_cases {
    use super::*;

    #[test]
    fn sequences_that_cannot_be_embedded() {
        let encoder = seeded();
        let shapes: [&[usize]; 4] = [
            &[1, 3, 8, 8],
            &[1, 4, 2, 8, 8],
            &[1, 3, 0, 8, 8],
            &[0, 3, 1, 8, 8],
        ];
        for shape in shapes {
            let sequences = Tensor::zeros(shape, DType::F32, &Device::Cpu).unwrap();
            let error = encoder.embed(&sequences).unwrap_err();
            assert!(matches!(error, Error::Input(input) if input.what == "images"));
        }
        let image = vec![0.5; 3 * 64 * 64];
        let error = encoder.embed_windows(&image, [64, 64], [32, 32], 8);
        let error = error.unwrap_err().to_string();
        assert!(error.starts_with("encoder: found i3d"), "{error}");
    }

    #[test]
    fn a_network_of_images_takes_no_sequence() {
        let kind = EncoderKind::EfficientNetLiteBody;
        let encoder = Encoder::seeded(kind, 1).unwrap();
        let sequence = Tensor::zeros((1, 3, 2, 8, 8), DType::F32, &Device::Cpu).unwrap();
        assert!(encoder.embed(&sequence).is_err());
        assert!(encoder.embed_pixels(&[&[0.5; 3 * 128]], [8, 8]).is_err());
    }

    #[test]
    fn sequences_of_one_value_and_of_odd_extents_are_finite() {
        let encoder = seeded();
        for (value, shape) in [
            (0.0_f32, (2, 3, 4, 9, 7)),
            (1e-40, (1, 3, 3, 8, 8)),
            (1.0, (1, 3, 17, 1, 1)),
            (0.5, (1, 3, 1, 3, 90)),
        ] {
            let sequences = Tensor::full(value, shape, &Device::Cpu).unwrap();
            let embedding = values(&encoder.embed(&sequences).unwrap());
            assert!(embedding.iter().all(|v| v.is_finite()));
        }
    }
}
