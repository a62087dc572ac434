//! The rule by which `fixtures/golden/make_golden.py` fills weights and inputs, and its files.
#![allow(dead_code, reason = "each test binary uses a part")]

use std::collections::HashMap;
use std::path::PathBuf;

use candle_core::{DType, Device, Tensor};
use sps_models::encoders::{Encoder, EncoderKind};
use sps_models::weights::Weights;

/// The repository.
pub(crate) fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Uniform values in [-1, 1): `SplitMix64` seeded by FNV-1a of the name.
pub(crate) fn uniform(name: &str, len: usize) -> Vec<f64> {
    let seed = name.bytes().fold(0xCBF2_9CE4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    });
    (1..=len as u64)
        .map(|i| {
            let mut z = seed.wrapping_add(i.wrapping_mul(0x9E37_79B9_7F4A_7C15));
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            z ^= z >> 31;
            (z >> 40) as f64 / f64::from(1 << 23) - 1.0
        })
        .collect()
}

/// An input tensor, f32.
pub(crate) fn input(name: &str, shape: &[usize]) -> Tensor {
    let values: Vec<f32> = uniform(name, shape.iter().product())
        .into_iter()
        .map(|u| u as f32)
        .collect();
    Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
}

/// One weight tensor, by its name and shape.
fn fill(name: &str, shape: &[usize]) -> Tensor {
    let norm = name.contains("bn") || name.contains("downsample.1.");
    let (_, leaf) = name.rsplit_once('.').unwrap();
    let fan_in: usize = shape[1..].iter().product();
    let rule = |u: f64| match leaf {
        "weight" if norm => 1.0 + 0.2 * u,
        "running_var" => 1.0 + 0.5 * u,
        "bias" | "running_mean" => 0.1 * u,
        _ => u * (3.0 / fan_in as f64).sqrt(),
    };
    let values: Vec<f32> = uniform(name, shape.iter().product())
        .into_iter()
        .map(|u| rule(u) as f32)
        .collect();
    Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
}

/// The weights of a network, filled by the rule.
pub(crate) fn weights(kind: EncoderKind) -> Weights {
    let tensors = kind
        .specs()
        .into_iter()
        .map(|spec| (spec.name.clone(), fill(&spec.name, &spec.shape)));
    Weights::from_tensors("the golden rule", tensors).unwrap()
}

/// An encoder with those weights.
pub(crate) fn encoder(kind: EncoderKind) -> Encoder {
    Encoder::new(kind, weights(kind)).unwrap()
}

/// The tensors of a golden file, f64.
pub(crate) fn golden(file: &str) -> HashMap<String, Tensor> {
    let path = root().join("fixtures/golden").join(file);
    candle_core::safetensors::load(path, &Device::Cpu).unwrap()
}

/// The norm of the difference relative to the norm expected.
pub(crate) fn relative_error(found: &Tensor, expected: &Tensor) -> f64 {
    assert_eq!(found.dims(), expected.dims());
    let norm = |t: &Tensor| -> f64 {
        let t = t.to_dtype(DType::F64).unwrap();
        let squares = t.sqr().unwrap().sum_all().unwrap();
        squares.to_scalar::<f64>().unwrap().sqrt()
    };
    let difference = found.to_dtype(DType::F64).unwrap() - expected.to_dtype(DType::F64).unwrap();
    let error = norm(&difference.unwrap()) / norm(expected);
    assert!(error.is_finite());
    error
}

/// The largest distance of two tensors' elements relative to the largest element expected.
pub(crate) fn worst_error(found: &Tensor, expected: &Tensor) -> f64 {
    let largest = |t: Tensor| -> f64 {
        let t = t.abs().unwrap().flatten_all().unwrap();
        t.max(0).unwrap().to_scalar().unwrap()
    };
    let difference = (found.to_dtype(DType::F64).unwrap() - expected).unwrap();
    largest(difference) / largest(expected.clone())
}
