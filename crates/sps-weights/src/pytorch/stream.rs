//! The format of `torch.save` before version 1.6: five pickles one after the other (a magic
//! number, a version, the machine, the object, the storages' keys), then the storages.

use std::collections::BTreeMap;

use super::value::{Heap, Storage, Value};
use super::{gather, not_little_endian, pickle};
use crate::{RawTensor, WeightsErrorKind};

const MAGIC: i128 = 0x1950_a86a_20f9_469c_fc6c;
const VERSION: i128 = 1001;

/// Whether the bytes begin as this format does: with a pickle of the magic number.
pub(super) fn is(bytes: &[u8]) -> bool {
    // PROTO, a version, then LONG1 of ten bytes.
    matches!(bytes, [0x80, _, 0x8a, 10, magic @ ..]
        if magic.starts_with(&MAGIC.to_le_bytes()[..10]))
}

pub(super) fn read(bytes: &[u8]) -> Result<Vec<(String, RawTensor)>, WeightsErrorKind> {
    let mut heap = Heap::default();
    let mut at = 0;
    let mut next = || pickle::run(bytes, &mut at, &mut heap);
    let (magic, version, machine) = (next()?, next()?, next()?);
    let (object, keys) = (next()?, next()?);
    if (magic, version) != (Value::Int(MAGIC), Value::Int(VERSION)) {
        let message = format!("version {version:?} of PyTorch's stream, expected {VERSION}");
        return Err(WeightsErrorKind::Format(message));
    }
    let little = ("little_endian", Value::Bool(true));
    if !matches!(machine, Value::Dictionary(at) if heap.entries(at).any(|entry| entry == little)) {
        return Err(not_little_endian());
    }
    let storages = storages(&heap, keys, &bytes[at..])?;
    let storage = |storage: &Storage| storages.get(&storage.key[..]).copied();
    gather(&heap, object, storage, bytes.len())
}

/// The bytes of each storage: its length as eight bytes, then its elements.
fn storages<'a>(
    heap: &'a Heap,
    keys: Value,
    mut rest: &'a [u8],
) -> Result<BTreeMap<&'a str, &'a [u8]>, WeightsErrorKind> {
    let Value::List(keys) = keys else {
        return Err(WeightsErrorKind::format("no list of the storages' keys"));
    };
    let known = heap.storages().iter();
    let known: BTreeMap<&str, _> = known.map(|storage| (&storage.key[..], storage)).collect();
    let mut storages = BTreeMap::new();
    for &key in heap.items(keys) {
        let key = heap.as_text(key).unwrap_or("");
        let Some(storage) = known.get(key) else {
            let message = format!("storage {key:?}, which no tensor has");
            return Err(WeightsErrorKind::Format(message));
        };
        let len = rest.split_first_chunk::<8>().and_then(|(len, after)| {
            rest = after;
            let len = usize::try_from(u64::from_le_bytes(*len)).ok()?;
            (len == storage.len).then(|| storage.bytes())?
        });
        let Some((elements, after)) = len.and_then(|len| rest.split_at_checked(len)) else {
            let message = format!("storage {key:?} does not hold its {} elements", storage.len);
            return Err(WeightsErrorKind::Format(message));
        };
        storages.insert(key, elements);
        rest = after;
    }
    Ok(storages)
}
