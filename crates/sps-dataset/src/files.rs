//! Reading whole files without trusting their size.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use crate::{DatasetError, DatasetErrorKind};

/// Why a file could not be read whole.
pub(crate) enum ReadError {
    Io(io::Error),
    TooLarge { bytes: u64, limit: u64 },
}

impl From<io::Error> for ReadError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// The bytes of a file of at most `limit` bytes.
pub(crate) fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>, ReadError> {
    let file = File::open(path)?;
    let metadata = file.metadata()?;
    if metadata.is_dir() {
        return Err(io::Error::from(io::ErrorKind::IsADirectory).into());
    }
    let size = metadata.len();
    if size > limit {
        return Err(ReadError::TooLarge { bytes: size, limit });
    }
    let mut bytes = Vec::with_capacity(size as usize);
    // The file may be a pipe, or grow while it is read.
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        return Err(ReadError::TooLarge {
            bytes: bytes.len() as u64,
            limit,
        });
    }
    Ok(bytes)
}

/// The bytes of a file of a dataset that is no frame.
pub(crate) fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>, DatasetError> {
    read_bytes(path, limit).map_err(|error| {
        let kind = match error {
            ReadError::Io(error) => DatasetErrorKind::Io(error),
            ReadError::TooLarge { bytes, limit } => DatasetErrorKind::TooLarge { bytes, limit },
        };
        DatasetError::file(path, kind)
    })
}

/// The text of a UTF-8 file, without the mark that spreadsheets put before it.
pub(crate) fn text<'a>(
    path: &Path,
    format: &'static str,
    bytes: &'a [u8],
) -> Result<&'a str, DatasetError> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    std::str::from_utf8(bytes).map_err(|error| {
        let line = bytes
            .iter()
            .take(error.valid_up_to())
            .filter(|&&byte| byte == b'\n')
            .count();
        let reason = "it has bytes that are not UTF-8 text".to_owned();
        let kind = DatasetErrorKind::Malformed { format, reason };
        DatasetError::line(path, line as u64 + 1, kind)
    })
}
