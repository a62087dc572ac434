//! Reading whole files without trusting their size, and what bytes say: text, integers.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use crate::DatasetError;
use crate::error::{Fault, Place};

/// The bytes of a file of at most `limit` bytes. `too_large` makes the error from the size that was
/// found.
pub(crate) fn read_bytes<E: From<io::Error>>(
    path: &Path,
    limit: u64,
    too_large: impl FnOnce(u64) -> E,
) -> Result<Vec<u8>, E> {
    let file = File::open(path)?;
    let metadata = file.metadata()?;
    if metadata.is_dir() {
        return Err(io::Error::from(io::ErrorKind::IsADirectory).into());
    }
    let mut size = metadata.len();
    let mut bytes = Vec::new();
    if size <= limit {
        bytes.reserve(size as usize);
        // The file may be a pipe, or grow while it is read.
        file.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
        size = bytes.len() as u64;
    }
    if size > limit {
        return Err(too_large(size));
    }
    Ok(bytes)
}

/// What `read` makes of the bytes of a file of a dataset that is no frame.
pub(crate) fn read_file<T>(
    path: &Path,
    limit: u64,
    read: impl FnOnce(&[u8]) -> Result<T, Fault>,
) -> Result<T, DatasetError> {
    let says = |bytes| format!("has {bytes} bytes, more than the limit of {limit}");
    let bytes = read_bytes(path, limit, |bytes| Fault::invalid(says(bytes)));
    let read = bytes.and_then(|bytes| read(&bytes));
    read.map_err(|fault| fault.of_file(path))
}

/// The text of a UTF-8 file, without the mark that spreadsheets put before it.
pub(crate) fn text<'a>(format: &str, bytes: &'a [u8]) -> Result<&'a str, Fault> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    std::str::from_utf8(bytes).map_err(|error| {
        let reason = "it has bytes that are not UTF-8 text";
        let line = line_of(bytes, error.valid_up_to());
        Fault::malformed(format, reason).at(line)
    })
}

/// The integer of at most eight bytes.
pub(crate) fn integer(bytes: &[u8], is_big_endian: bool) -> u64 {
    let add = |all: u64, byte: &u8| all << 8 | u64::from(*byte);
    if is_big_endian {
        bytes.iter().fold(0, add)
    } else {
        bytes.iter().rev().fold(0, add)
    }
}

/// The line that a byte is in.
pub(crate) fn line_of(bytes: &[u8], at: usize) -> Place {
    let before = bytes.iter().take(at);
    Place::Line(1 + before.filter(|&&byte| byte == b'\n').count() as u64)
}
