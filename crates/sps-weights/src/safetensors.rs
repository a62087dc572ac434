//! Tensors from a safetensors file.

use std::borrow::Cow;
use std::collections::HashMap;

use half::{bf16, f16};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensorError, SafeTensors, View};

use crate::{RawTensor, Storage, WeightsErrorKind};

/// Every tensor of the file, its elements as f32.
pub(super) fn read(bytes: &[u8]) -> Result<Vec<(String, RawTensor)>, WeightsErrorKind> {
    let file = SafeTensors::deserialize(bytes).map_err(|error| not_safetensors(&error))?;
    let tensor = |(name, view): (String, TensorView<'_>)| {
        let shape = view.shape().to_vec();
        let all = 0..shape.iter().product();
        let values = to_f32(&name, view.dtype(), view.data(), all)?;
        Ok((name, RawTensor { shape, values }))
    };
    file.tensors().into_iter().map(tensor).collect()
}

/// The tensors as a safetensors file, with a note (its name and text) in the metadata; the same tensors give the same bytes.
///
/// # Errors
/// A tensor whose values do not fill its shape or are not finite: it could not be read back.
pub fn write<'a>(
    tensors: impl IntoIterator<Item = (&'a str, RawTensor)>,
    storage: Storage,
    note: Option<(&str, &str)>,
) -> Result<Vec<u8>, WeightsErrorKind> {
    let checked = |(name, tensor): (&'a str, RawTensor)| {
        tensor.check(name)?;
        Ok((name, Stored { tensor, storage }))
    };
    let stored = tensors.into_iter().map(checked);
    let stored = stored.collect::<Result<Vec<_>, WeightsErrorKind>>()?;
    let note = note.map(|(name, text)| HashMap::from([(name.to_owned(), text.to_owned())]));
    safetensors::serialize(stored, note)
        .map_err(|error| WeightsErrorKind::Format(format!("cannot be written: {error}")))
}

/// A tensor on its way into a file: it has bytes when it is its turn, and is gone thereafter.
struct Stored {
    tensor: RawTensor,
    storage: Storage,
}

impl View for Stored {
    fn dtype(&self) -> Dtype {
        match self.storage {
            Storage::F32 => Dtype::F32,
            Storage::F16 => Dtype::F16,
        }
    }

    fn shape(&self) -> &[usize] {
        &self.tensor.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        let values = self.tensor.values.iter();
        let half = |&v: &f32| f16::from_f32(v).to_le_bytes();
        match self.storage {
            Storage::F32 => values.flat_map(|v| v.to_le_bytes()).collect(),
            Storage::F16 => values.flat_map(half).collect(),
        }
    }

    fn data_len(&self) -> usize {
        self.tensor.values.len() * self.dtype().bitsize() / 8
    }
}

/// A note that [`write()`] put into a file.
///
/// # Errors
/// When it is no safetensors file or has no note of this name.
pub fn note(bytes: &[u8], name: &str) -> Result<String, WeightsErrorKind> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|error| not_safetensors(&error))?;
    let note = header.metadata().as_ref().and_then(|all| all.get(name));
    let missing = || WeightsErrorKind::Format(format!("no {name:?} in the metadata"));
    note.cloned().ok_or_else(missing)
}

fn not_safetensors(error: &SafeTensorError) -> WeightsErrorKind {
    WeightsErrorKind::Format(format!("not a safetensors file: {error}"))
}

/// The elements at some places of a tensor's data, which must hold them.
pub(super) fn to_f32(
    name: &str,
    dtype: Dtype,
    data: &[u8],
    places: impl Iterator<Item = usize>,
) -> Result<Vec<f32>, WeightsErrorKind> {
    Ok(match dtype {
        Dtype::F16 => pick(data, places, |b| f16::from_le_bytes(b).to_f32()),
        Dtype::BF16 => pick(data, places, |b| bf16::from_le_bytes(b).to_f32()),
        Dtype::F32 => pick(data, places, f32::from_le_bytes),
        Dtype::F64 => pick(data, places, |b| f64::from_le_bytes(b) as f32),
        // `num_batches_tracked`: a count, never used as a number here.
        Dtype::I64 => pick(data, places, |b| i64::from_le_bytes(b) as f32),
        other => {
            let what = format!("has elements of type {other:?}, expected f16, bf16, f32 or f64");
            return Err(WeightsErrorKind::tensor(name, what));
        }
    })
}

fn pick<const N: usize>(
    data: &[u8],
    places: impl Iterator<Item = usize>,
    decode: impl Fn([u8; N]) -> f32,
) -> Vec<f32> {
    let (elements, _) = data.as_chunks::<N>();
    places.map(|place| decode(elements[place])).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn extents_whose_product_no_number_holds() {
        // No element, so that nothing else is wrong with it.
        let header =
            br#"{"a":{"dtype":"F32","shape":[0,4294967296,4294967296],"data_offsets":[0,0]}}"#;
        let bytes = [&(header.len() as u64).to_le_bytes()[..], header].concat();
        let error = crate::read(&bytes).unwrap_err();
        let found = "[0, 4294967296, 4294967296], whose product no number holds";
        assert!(error.to_string().ends_with(found), "{error}");
    }
}
