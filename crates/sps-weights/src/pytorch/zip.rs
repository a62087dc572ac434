//! The format of `torch.save` since version 1.6: an archive that nothing is compressed in, with
//! a pickle `data.pkl` and a file `data/KEY` for each storage.

use std::collections::BTreeMap;
use std::io::Cursor;

use zip::{CompressionMethod, ZipArchive};

use super::value::Heap;
use super::{gather, pickle};
use crate::{RawTensor, WeightsErrorKind};

/// Whether the bytes begin as an archive does.
pub(super) fn is(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

pub(super) fn read(bytes: &[u8]) -> Result<Vec<(String, RawTensor)>, WeightsErrorKind> {
    let files = files(bytes)?;
    let mut pickles = files
        .keys()
        .filter_map(|name| name.strip_suffix("data.pkl"));
    let (Some(folder), None) = (pickles.next(), pickles.next()) else {
        return Err(WeightsErrorKind::format(
            "an archive without one file data.pkl",
        ));
    };
    let file = |name: &str| files.get(&format!("{folder}{name}")).copied();
    if file("byteorder").is_some_and(|order| order != b"little") {
        return Err(WeightsErrorKind::format(
            "elements that are not little-endian",
        ));
    }
    let mut heap = Heap::default();
    let (object, _) = pickle::run(file("data.pkl").unwrap_or_default(), &mut heap)?;
    let storages = heap.storages().iter().filter_map(|storage| {
        let bytes = file(&format!("data/{}", storage.key))?;
        Some((storage.key.as_str(), bytes))
    });
    let storages: BTreeMap<&str, &[u8]> = storages.collect();
    gather(&heap, object, &storages, bytes.len())
}

/// The files of the archive, as they lie in it.
fn files(bytes: &[u8]) -> Result<BTreeMap<String, &[u8]>, WeightsErrorKind> {
    let wrong = |error| WeightsErrorKind::format(format_args!("not an archive: {error}"));
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(wrong)?;
    let mut files = BTreeMap::new();
    for index in 0..archive.len() {
        let file = archive.by_index_raw(index).map_err(wrong)?;
        let name = file.name().map_err(wrong)?.into_owned();
        if file.compression() != CompressionMethod::Stored || file.encrypted() {
            return Err(WeightsErrorKind::format(format_args!(
                "{name:?} in the archive is compressed"
            )));
        }
        let range = file.data_start().and_then(|start| {
            let (start, len) = (
                usize::try_from(start).ok()?,
                usize::try_from(file.size()).ok()?,
            );
            bytes.get(start..start.checked_add(len)?)
        });
        let content = range.ok_or_else(|| {
            WeightsErrorKind::format(format_args!("{name:?} reaches beyond the file"))
        })?;
        files.insert(name, content);
    }
    Ok(files)
}
