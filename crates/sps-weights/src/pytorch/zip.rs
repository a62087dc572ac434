//! The format of `torch.save` since version 1.6: an archive that nothing is compressed in, with
//! a pickle `data.pkl` and a file `data/KEY` for each storage.

use std::collections::BTreeMap;
use std::io::Cursor;

use zip::{CompressionMethod, ZipArchive};

use super::value::{Heap, Storage};
use super::{gather, not_little_endian, pickle};
use crate::{RawTensor, WeightsErrorKind};

/// Whether the bytes begin as an archive does.
pub(super) fn is(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

pub(super) fn read(bytes: &[u8]) -> Result<Vec<(String, RawTensor)>, WeightsErrorKind> {
    let files = files(bytes)?;
    let pickles = files.iter();
    let mut pickles =
        pickles.filter_map(|(name, content)| Some((name.strip_suffix("data.pkl")?, *content)));
    let (Some((folder, pickle)), None) = (pickles.next(), pickles.next()) else {
        let message = "an archive without one file data.pkl";
        return Err(WeightsErrorKind::format(message));
    };
    let file = |name: &str| files.get(&format!("{folder}{name}")).copied();
    if file("byteorder").is_some_and(|order| order != b"little") {
        return Err(not_little_endian());
    }
    let mut heap = Heap::default();
    let object = pickle::run(pickle, &mut 0, &mut heap)?;
    let storage = |storage: &Storage| file(&format!("data/{}", storage.key));
    gather(&heap, object, storage, bytes.len())
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
            let message = format!("{name:?} in the archive is compressed");
            return Err(WeightsErrorKind::Format(message));
        }
        let range = file.data_start().and_then(|start| {
            let start = usize::try_from(start).ok()?;
            let len = usize::try_from(file.size()).ok()?;
            bytes.get(start..start.checked_add(len)?)
        });
        let beyond = || WeightsErrorKind::Format(format!("{name:?} reaches beyond the file"));
        let content = range.ok_or_else(beyond)?;
        files.insert(name, content);
    }
    Ok(files)
}
