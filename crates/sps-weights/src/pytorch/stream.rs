//! The format of `torch.save` before version 1.6: five pickles one after the other (a magic
//! number, a version, the machine, the object, the storages' keys), then the storages.

use std::collections::BTreeMap;

use super::value::{Heap, Value};
use super::{gather, pickle};
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
    let mut rest = bytes;
    let mut next = || -> Result<Value, WeightsErrorKind> {
        let (value, len) = pickle::run(rest, &mut heap).map_err(|kind| later(kind, bytes, rest))?;
        rest = &rest[len..];
        Ok(value)
    };
    let (magic, version, machine) = (next()?, next()?, next()?);
    let (object, keys) = (next()?, next()?);
    if (magic, version) != (Value::Int(MAGIC), Value::Int(VERSION)) {
        return Err(WeightsErrorKind::format(format_args!(
            "version {version:?} of PyTorch's stream, expected {VERSION}"
        )));
    }
    check_order(&heap, machine)?;
    let storages = storages(&heap, keys, rest)?;
    gather(&heap, object, &storages, bytes.len())
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
    let known: BTreeMap<&str, _> = heap
        .storages()
        .iter()
        .map(|storage| (storage.key.as_str(), storage))
        .collect();
    let mut storages = BTreeMap::new();
    for &key in heap.items(keys) {
        let key = heap.as_text(key).unwrap_or("");
        let Some(storage) = known.get(key) else {
            return Err(WeightsErrorKind::format(format_args!(
                "storage {key:?}, which no tensor has"
            )));
        };
        let len = rest.split_first_chunk::<8>().and_then(|(len, after)| {
            rest = after;
            let len = usize::try_from(u64::from_le_bytes(*len)).ok()?;
            (len == storage.len).then(|| storage.bytes())?
        });
        let Some((elements, after)) = len.and_then(|len| rest.split_at_checked(len)) else {
            return Err(WeightsErrorKind::format(format_args!(
                "storage {key:?} does not hold its {} elements",
                storage.len
            )));
        };
        storages.insert(key, elements);
        rest = after;
    }
    Ok(storages)
}

fn check_order(heap: &Heap, machine: Value) -> Result<(), WeightsErrorKind> {
    let little = match machine {
        Value::Dictionary(machine) => heap
            .entries(machine)
            .any(|(key, value)| key == "little_endian" && value == Value::Bool(true)),
        _ => false,
    };
    if little {
        return Ok(());
    }
    Err(WeightsErrorKind::format(
        "elements that are not little-endian",
    ))
}

/// An offset in a later pickle as one in the file.
fn later(kind: WeightsErrorKind, bytes: &[u8], rest: &[u8]) -> WeightsErrorKind {
    match kind {
        WeightsErrorKind::Pickle { offset, found } => WeightsErrorKind::Pickle {
            offset: offset + bytes.len() - rest.len(),
            found,
        },
        other => other,
    }
}
