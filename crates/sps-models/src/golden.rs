//! Tensors as the scripts in `fixtures/golden` fill them, and the files they wrote.

use std::collections::HashMap;

use candle_core::{DType, Device, Tensor};

use crate::weights::TensorSpec;

#[path = "../../../fixtures/golden/rule.rs"]
mod rule;
#[path = "../../../fixtures/golden/weights.rs"]
mod weights;

pub(crate) use rule::{error, uniform};

/// Such values as a tensor, f64.
pub(crate) fn tensor(name: &str, shape: &[usize]) -> Tensor {
    let values = uniform(name, shape.iter().product());
    Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
}

/// A network's tensor as the scripts fill it, f32.
pub(crate) fn weight(spec: &TensorSpec) -> Tensor {
    let values = weights::weight(&spec.name, &spec.shape);
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
