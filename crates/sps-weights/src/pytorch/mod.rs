//! Tensors from PyTorch's files: the zip format of today, and the stream of versions before 1.6.

mod pickle;
mod stream;
#[cfg(test)]
mod tests;
mod value;
mod zip;

use crate::safetensors::to_f32;
use crate::{RawTensor, WeightsErrorKind};
use value::{Heap, Storage, Value, View, tensors};

/// Every tensor of such a file, its elements as f32; `None` where the bytes begin as neither format does.
pub(super) fn read(bytes: &[u8]) -> Option<Result<Vec<(String, RawTensor)>, WeightsErrorKind>> {
    if zip::is(bytes) {
        return Some(zip::read(bytes));
    }
    stream::is(bytes).then(|| stream::read(bytes))
}

/// Copies a dictionary's tensors out of the storages, whose bytes are given by key.
///
/// All tensors together may have no more elements than a file of this length could hold.
fn gather<'a>(
    heap: &Heap,
    dictionary: Value,
    bytes: impl Fn(&Storage) -> Option<&'a [u8]>,
    file_len: usize,
) -> Result<Vec<(String, RawTensor)>, WeightsErrorKind> {
    let views = tensors(heap, dictionary)?;
    let counts = views.iter().map(|(_, view)| view.len());
    let count = counts.fold(0, usize::saturating_add);
    if count > file_len {
        let message = format!("tensors of {count} elements together in a file of {file_len} bytes");
        return Err(WeightsErrorKind::Format(message));
    }
    let tensor = |(name, view): (&str, &View)| {
        let storage = &heap.storages()[view.storage];
        let bytes = bytes(storage).unwrap_or_default();
        let Storage { key, element, len } = storage;
        if Some(bytes.len()) != storage.bytes() {
            let expected = format_args!("{} bytes, expected {len} {element:?}", bytes.len());
            let message = format!("storage {key:?} of tensor {name:?} has {expected}");
            return Err(WeightsErrorKind::Format(message));
        }
        let values = to_f32(name, *element, bytes, view.places())?;
        let shape = view.shape.clone();
        Ok((name.to_owned(), RawTensor { shape, values }))
    };
    views.into_iter().map(tensor).collect()
}

fn not_little_endian() -> WeightsErrorKind {
    WeightsErrorKind::format("elements that are not little-endian")
}
