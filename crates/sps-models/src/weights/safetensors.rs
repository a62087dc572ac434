//! Tensors from a safetensors file.

use half::{bf16, f16};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensorError, SafeTensors};

use super::{RawTensor, WeightsErrorKind};

/// Every tensor of the file, its elements as f32.
pub(super) fn read(bytes: &[u8]) -> Result<Vec<(String, RawTensor)>, WeightsErrorKind> {
    let file = SafeTensors::deserialize(bytes)
        .map_err(|error| WeightsErrorKind::Format(format!("not a safetensors file: {error}")))?;
    file.tensors()
        .into_iter()
        .map(|(name, view)| {
            let values = to_f32(&name, view.dtype(), view.data())?;
            let shape = view.shape().to_vec();
            Ok((name, RawTensor { shape, values }))
        })
        .collect()
}

/// The tensors as a file of f32.
pub(super) fn write(tensors: &[(&str, RawTensor)]) -> Result<Vec<u8>, WeightsErrorKind> {
    let bytes: Vec<Vec<u8>> = tensors
        .iter()
        .map(|(_, tensor)| tensor.values.iter().flat_map(|v| v.to_le_bytes()).collect())
        .collect();
    let views = tensors.iter().zip(&bytes).map(|((name, tensor), bytes)| {
        let view = TensorView::new(Dtype::F32, tensor.shape.clone(), bytes)?;
        Ok((*name, view))
    });
    views
        .collect::<Result<Vec<_>, SafeTensorError>>()
        .and_then(|views| safetensors::serialize(views, None))
        .map_err(|error| WeightsErrorKind::Format(format!("cannot be written: {error}")))
}

fn to_f32(name: &str, dtype: Dtype, data: &[u8]) -> Result<Vec<f32>, WeightsErrorKind> {
    Ok(match dtype {
        Dtype::F16 => elements(data, |b| f16::from_le_bytes(b).to_f32()),
        Dtype::BF16 => elements(data, |b| bf16::from_le_bytes(b).to_f32()),
        Dtype::F32 => elements(data, f32::from_le_bytes),
        Dtype::F64 => elements(data, |b| f64::from_le_bytes(b) as f32),
        // `num_batches_tracked`: a count, never used as a number here.
        Dtype::I64 => elements(data, |b| i64::from_le_bytes(b) as f32),
        other => {
            return Err(WeightsErrorKind::ElementType {
                tensor: name.to_owned(),
                found: format!("{other:?}"),
            });
        }
    })
}

fn elements<const N: usize>(data: &[u8], decode: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    let (elements, _) = data.as_chunks::<N>();
    elements.iter().map(|bytes| decode(*bytes)).collect()
}
