use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// A frame that cannot be had, or a dataset that cannot be written: which file or folder, and why.
#[derive(Debug, thiserror::Error)]
#[error("{}: {kind}", path.display())]
pub struct FileError<K> {
    path: PathBuf,
    kind: K,
}

impl<K> FileError<K> {
    pub(crate) fn new(path: &Path, kind: K) -> Self {
        Self {
            path: path.to_owned(),
            kind,
        }
    }

    /// The file or folder; of a frame that is not there, the folder that should have had it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Why.
    pub fn kind(&self) -> &K {
        &self.kind
    }
}

/// A dataset, or a table of one, that cannot be read: which file, where in it, and why.
///
/// Frames have their own [`FrameError`](crate::FrameError).
#[derive(Debug, thiserror::Error)]
#[error("{}{}{place}: {kind}", path.display(), if *place == Place::File { "" } else { ", " })]
pub struct DatasetError {
    path: PathBuf,
    place: Place,
    kind: DatasetErrorKind,
}

/// Why a dataset cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetErrorKind {
    /// The file or folder cannot be opened or read.
    #[error("cannot be read: {0}")]
    Io(io::Error),
    /// The file breaks the rules of its format, is too large, or says what no dataset can have.
    #[error("{0}")]
    Invalid(String),
}

/// View angles, a range or an order of properties that no dataset can have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct InvalidValue(pub(crate) String);

/// Where in a file something was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// The file as a whole.
    File,
    /// A line, from 1.
    Line(u64),
    /// A key of a JSON object, or an array of an NPZ archive.
    Key(String),
}

/// What is wrong in a file, and where in it; whoever opened the file adds its name.
pub(crate) struct Fault {
    place: Place,
    kind: DatasetErrorKind,
}

impl DatasetError {
    /// The file or folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The line of the file, from 1, where it was found in one.
    pub fn line(&self) -> Option<u64> {
        match self.place {
            Place::Line(line) => Some(line),
            Place::File | Place::Key(_) => None,
        }
    }

    /// Why.
    pub fn kind(&self) -> &DatasetErrorKind {
        &self.kind
    }
}

impl Fault {
    pub(crate) fn of_file(self, path: &Path) -> DatasetError {
        DatasetError {
            path: path.to_owned(),
            place: self.place,
            kind: self.kind,
        }
    }

    pub(crate) fn at(self, place: Place) -> Self {
        Self { place, ..self }
    }

    pub(crate) fn at_key(self, key: &str) -> Self {
        self.at(Place::Key(key.to_owned()))
    }

    pub(crate) fn invalid(text: String) -> Self {
        Self {
            place: Place::File,
            kind: DatasetErrorKind::Invalid(text),
        }
    }

    pub(crate) fn malformed(format: &str, reason: impl fmt::Display) -> Self {
        Self::invalid(format!("is not valid {format}: {reason}"))
    }

    pub(crate) fn unexpected(
        what: impl fmt::Display,
        found: impl fmt::Display,
        expected: impl fmt::Display,
    ) -> Self {
        Self::invalid(format!("{what}: found {found}, expected {expected}"))
    }

    /// A text where a number belongs.
    pub(crate) fn not_a_number(column: &str, found: impl fmt::Display, expected: &str) -> Self {
        let found = format!("found `{found}` in column `{column}`");
        Self::invalid(format!("{found}, expected {expected}"))
    }

    pub(crate) fn twice(surface: &str, first: &Place) -> Self {
        let twice = format!("surface `{surface}` is listed twice");
        Self::invalid(format!("{twice}, first at {first}"))
    }

    /// A table whose columns carry no names, and no order was given for them.
    pub(crate) fn no_property_order() -> Self {
        let text = "the order of its properties is not given: the file does not name its columns, so \
                    `property-order` must list the tactile property of each, in order";
        Self::invalid(text.to_owned())
    }
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        Self {
            place: Place::File,
            kind: DatasetErrorKind::Io(error),
        }
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
