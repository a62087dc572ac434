//! Tensors as the scripts in `fixtures/golden` fill them, and the files they wrote.

use std::collections::HashMap;

use candle_core::{DType, Device, Tensor};

use crate::weights::TensorSpec;

#[path = "../../../fixtures/golden/rule.rs"]
mod rule;

pub(crate) use rule::{error, uniform};

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
