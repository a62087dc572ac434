//! The rule by which the scripts in `fixtures/golden` fill tensors, and the files they wrote.

use std::collections::HashMap;

use candle_core::{DType, Device, Tensor};

use crate::weights::TensorSpec;

/// Uniform values in [-1, 1): SplitMix64 seeded by FNV-1a of the name.
pub(crate) fn uniform(name: &str, len: usize) -> Vec<f64> {
    let mut state = name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    let draw = |_| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f64 / f64::from(1 << 23) - 1.0
    };
    (0..len).map(draw).collect()
}

/// Such values as a tensor, f64.
pub(crate) fn tensor(name: &str, shape: &[usize]) -> Tensor {
    let values = uniform(name, shape.iter().product());
    Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
}

/// A network's tensor as the scripts fill it, f32.
pub(crate) fn weight(spec: &TensorSpec) -> Tensor {
    let norm = spec.name.contains("bn") || spec.name.contains("downsample.1.");
    let fan_in: usize = spec.shape[1..].iter().product();
    let rule = |u: f64| match spec.name.rsplit('.').next() {
        Some("weight") if norm => 1.0 + 0.2 * u,
        Some("running_var") => 1.0 + 0.5 * u,
        Some("bias" | "running_mean") => 0.1 * u,
        _ => u * (3.0 / fan_in as f64).sqrt(),
    };
    let values = uniform(&spec.name, spec.shape.iter().product()).into_iter();
    let values: Vec<f32> = values.map(|u| rule(u) as f32).collect();
    Tensor::from_vec(values, spec.shape.as_slice(), &Device::Cpu).unwrap()
}

/// The tensors of a file.
pub(crate) fn load(file: &str) -> HashMap<String, Tensor> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/golden");
    candle_core::safetensors::load(folder.join(file), &Device::Cpu).unwrap()
}

/// The elements of a tensor of either type, f64.
pub(crate) fn values(tensor: &Tensor) -> Vec<f64> {
    let tensor = tensor.to_dtype(DType::F64).unwrap();
    tensor.flatten_all().unwrap().to_vec1().unwrap()
}

/// The largest difference, over the largest expected value.
pub(crate) fn error(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(0.0_f64, |max, e| max.max(e.abs()));
    let differences = found.iter().zip(expected).map(|(f, e)| (f - e).abs());
    differences.fold(0.0, f64::max) / largest
}
