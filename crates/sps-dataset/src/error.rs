use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::{InvalidCode, Property, UnknownName};

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
    /// The path is not a folder with a `dataset.toml`.
    #[error("not a dataset: {0}")]
    NotADataset(&'static str),
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
    /// A table whose columns carry no names, and no order was given for them.
    #[error(
        "the order of its properties is not given: the file does not name its columns, so \
         `property-order` must list the tactile property of each, in order"
    )]
    NoPropertyOrder,
    /// A text where a number belongs.
    #[error("found `{found}` in column `{column}`, expected {expected}")]
    NotANumber {
        /// The column or key.
        column: String,
        /// What stands there.
        found: String,
        /// Which numbers would have been right.
        expected: &'static str,
    },
    /// A value outside of its property's range under
    /// [`RangePolicy::Reject`](crate::RangePolicy::Reject), or one that is more than 1e9 from 0 once it
    /// was restored.
    #[error("{property} of `{surface}` is {value}, outside {low} to {high}, and is to be rejected")]
    OutOfRange {
        /// The surface touched.
        surface: String,
        /// The property measured.
        property: Property,
        /// The value read.
        value: f64,
        /// The lowest value that is taken.
        low: f64,
        /// The highest.
        high: f64,
    },
    /// A value outside of the range that the dataset declares for its property.
    #[error(
        "{property} of `{surface}` is {value}, outside {low} to {high}, the range that the dataset \
         declares"
    )]
    OutOfDeclaredRange {
        /// The surface touched.
        surface: String,
        /// The property measured.
        property: Property,
        /// The value read.
        value: f64,
        /// The lowest value declared.
        low: f64,
        /// The highest value declared.
        high: f64,
    },
    /// A surface that was listed before.
    #[error("surface `{surface}` is listed twice, first at {first}")]
    DuplicateSurface {
        /// The surface.
        surface: String,
        /// Where it was first.
        first: Place,
    },
    /// The same touch twice.
    #[error(
        "location {location}, repeat {repeat} of surface `{surface}` is listed twice, first at {first}"
    )]
    DuplicateReading {
        /// The surface.
        surface: String,
        /// The location on it.
        location: u32,
        /// The repeat at that location.
        repeat: u32,
        /// Where it was first.
        first: Place,
    },
    /// Something else than what belongs there.
    #[error("{what}: found {found}, expected {expected}")]
    Unexpected {
        /// What is being read.
        what: String,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
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
        what: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::Unexpected {
            what: what.into(),
            found: found.into(),
            expected: expected.into(),
        }
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
