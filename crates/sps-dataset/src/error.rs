use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::{InvalidCode, UnknownName};

/// A dataset, or a table of one, that cannot be read: which file, where in it, and why.
///
/// Frames have their own [`FrameError`](crate::FrameError).
#[derive(Debug, thiserror::Error)]
#[error("{}{}{place}: {kind}", path.display(), place.separator())]
pub struct DatasetError {
    path: PathBuf,
    place: Place,
    kind: Box<DatasetErrorKind>,
}

/// Where in a file something was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    File,
    /// A line, from 1.
    Line(u64),
    /// A key of a JSON object, or an array of an NPZ archive.
    Key(String),
}

/// Why a dataset cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetErrorKind {
    /// The file or folder cannot be opened or read.
    #[error("cannot be read: {0}")]
    Io(io::Error),
    /// The file is larger than the reader allows.
    #[error("has {bytes} bytes, more than the limit of {limit}")]
    TooLarge {
        /// Its size.
        bytes: u64,
        /// The largest size allowed.
        limit: u64,
    },
    /// The file breaks the rules of its format.
    #[error("is not valid {format}: {reason}")]
    Malformed {
        /// The format, for example `TOML`.
        format: &'static str,
        /// What is wrong.
        reason: String,
    },
    /// A key, value or surface that there is not.
    #[error("{0}")]
    UnknownName(UnknownName),
    /// A column whose name cannot be the code of a property.
    #[error("{0}; `ignore-columns` leaves a column out")]
    InvalidCode(InvalidCode),
    /// The file is sound, but says what no dataset can have.
    #[error("{0}")]
    Invalid(String),
}

impl DatasetError {
    pub(crate) fn new(path: &Path, place: Place, kind: DatasetErrorKind) -> Self {
        Self {
            path: path.to_owned(),
            place,
            kind: Box::new(kind),
        }
    }

    pub(crate) fn file(path: &Path, kind: DatasetErrorKind) -> Self {
        Self::new(path, Place::File, kind)
    }

    pub(crate) fn line(path: &Path, line: u64, kind: DatasetErrorKind) -> Self {
        Self::new(path, Place::Line(line), kind)
    }

    pub(crate) fn key(path: &Path, key: &str, kind: DatasetErrorKind) -> Self {
        Self::new(path, Place::Key(key.to_owned()), kind)
    }

    /// The file or folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where in it.
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// Why.
    pub fn kind(&self) -> &DatasetErrorKind {
        &self.kind
    }
}

impl DatasetErrorKind {
    pub(crate) fn unexpected(
        what: impl fmt::Display,
        found: impl fmt::Display,
        expected: impl fmt::Display,
    ) -> Self {
        Self::Invalid(format!("{what}: found {found}, expected {expected}"))
    }

    /// A text where a number belongs.
    pub(crate) fn not_a_number(column: &str, found: &str, expected: &str) -> Self {
        Self::Invalid(format!(
            "found `{found}` in column `{column}`, expected {expected}"
        ))
    }

    pub(crate) fn twice(surface: &str, first: &Place) -> Self {
        Self::Invalid(format!(
            "surface `{surface}` is listed twice, first at {first}"
        ))
    }

    /// A table whose columns carry no names, and no order was given for them.
    pub(crate) fn no_property_order() -> Self {
        Self::Invalid(
            "the order of its properties is not given: the file does not name its columns, so \
             `property-order` must list the tactile property of each, in order"
                .to_owned(),
        )
    }
}

impl Place {
    fn separator(&self) -> &'static str {
        if *self == Self::File { "" } else { ", " }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => Ok(()),
            Self::Line(line) => write!(f, "line {line}"),
            Self::Key(key) => write!(f, "key `{key}`"),
        }
    }
}
