//! Tensors from PyTorch's files: the zip format of today, and the stream of versions before 1.6.

mod pickle;
mod stream;
#[cfg(test)]
mod tests;
mod value;
mod zip;

use std::collections::BTreeMap;

use crate::{RawTensor, WeightsErrorKind};
use half::{bf16, f16};
use value::{ElementType, Heap, Storage, Value, View, tensors};

/// Every tensor of the file, its elements as f32; `None` where the bytes are no such file.
pub(super) fn read(bytes: &[u8]) -> Option<Result<Vec<(String, RawTensor)>, WeightsErrorKind>> {
    if zip::is(bytes) {
        Some(zip::read(bytes))
    } else if stream::is(bytes) {
        Some(stream::read(bytes))
    } else {
        None
    }
}

/// Copies a dictionary's tensors out of the storages, whose bytes are given by key.
///
/// All tensors together may have no more elements than a file of this length could hold.
fn gather(
    heap: &Heap,
    dictionary: Value,
    bytes: &BTreeMap<&str, &[u8]>,
    file_len: usize,
) -> Result<Vec<(String, RawTensor)>, WeightsErrorKind> {
    let views = tensors(heap, dictionary)?;
    let count = views
        .iter()
        .fold(0_usize, |n, (_, view)| n.saturating_add(view.len()));
    if count > file_len {
        return Err(WeightsErrorKind::Format(format!(
            "tensors of {count} elements together in a file of {file_len} bytes"
        )));
    }
    views
        .into_iter()
        .map(|(name, view)| {
            let storage = &heap.storages()[view.storage];
            let tensor = tensor(
                name,
                view,
                storage,
                bytes.get(storage.key.as_str()).copied(),
            )?;
            Ok((name.to_owned(), tensor))
        })
        .collect()
}

fn tensor(
    name: &str,
    view: &View,
    storage: &Storage,
    bytes: Option<&[u8]>,
) -> Result<RawTensor, WeightsErrorKind> {
    let bytes = bytes.unwrap_or_default();
    if Some(bytes.len()) != storage.len.checked_mul(storage.element.bytes()) {
        return Err(WeightsErrorKind::Format(format!(
            "storage {:?} of tensor {name:?} has {} bytes, expected {} {:?}",
            storage.key,
            bytes.len(),
            storage.len,
            storage.element
        )));
    }
    let values = match storage.element {
        ElementType::F16 => pick(view, bytes, |b| f16::from_le_bytes(b).to_f32()),
        ElementType::BF16 => pick(view, bytes, |b| bf16::from_le_bytes(b).to_f32()),
        ElementType::F32 => pick(view, bytes, f32::from_le_bytes),
        ElementType::F64 => pick(view, bytes, |b| f64::from_le_bytes(b) as f32),
        // `num_batches_tracked`: a count, never used as a number here.
        ElementType::I64 => pick(view, bytes, |b| i64::from_le_bytes(b) as f32),
        other => {
            return Err(WeightsErrorKind::ElementType {
                tensor: name.to_owned(),
                found: format!("{other:?}"),
            });
        }
    };
    Ok(RawTensor {
        shape: view.shape.clone(),
        values,
    })
}

fn pick<const N: usize>(view: &View, bytes: &[u8], decode: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    let (elements, _) = bytes.as_chunks::<N>();
    view.places().map(|place| decode(elements[place])).collect()
}
