//! Tensors from PyTorch's files: the zip format of today, and the stream of versions before 1.6.

mod pickle;
mod stream;
#[cfg(test)]
mod tests;
mod value;
mod zip;

use std::collections::BTreeMap;

use crate::safetensors::to_f32;
use crate::{RawTensor, WeightsErrorKind};
use value::{Heap, Storage, Value, View, tensors};

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
    let counts = views.iter().map(|(_, view)| view.len());
    let count = counts.fold(0, usize::saturating_add);
    if count > file_len {
        return Err(WeightsErrorKind::format(format_args!(
            "tensors of {count} elements together in a file of {file_len} bytes"
        )));
    }
    let tensor = |(name, view): (&str, &View)| {
        let storage = &heap.storages()[view.storage];
        let bytes = bytes.get(storage.key.as_str()).copied();
        let tensor = tensor(name, view, storage, bytes.unwrap_or_default())?;
        Ok((name.to_owned(), tensor))
    };
    views.into_iter().map(tensor).collect()
}

fn tensor(
    name: &str,
    view: &View,
    storage: &Storage,
    bytes: &[u8],
) -> Result<RawTensor, WeightsErrorKind> {
    let Storage { key, element, len } = storage;
    if Some(bytes.len()) != storage.bytes() {
        let found = bytes.len();
        return Err(WeightsErrorKind::format(format_args!(
            "storage {key:?} of tensor {name:?} has {found} bytes, expected {len} {element:?}"
        )));
    }
    Ok(RawTensor {
        shape: view.shape.clone(),
        values: to_f32(name, *element, bytes, view.places())?,
    })
}
