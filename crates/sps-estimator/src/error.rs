use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use sps_base::Unexpected;

/// The result of everything in this crate that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong in this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An encoder or a regression refused what it was given, or could not be read.
    #[error(transparent)]
    Model(#[from] sps_models::Error),
    /// An ONNX file or an image for it was refused.
    #[error(transparent)]
    Onnx(#[from] sps_onnx::OnnxError),
    /// A photograph could not be read.
    #[error(transparent)]
    Photograph(#[from] sps_dataset::FrameError),
    /// A photograph in memory has not the pixels that it says, or too many.
    #[error(transparent)]
    Pixels(#[from] sps_dataset::FrameErrorKind),
    /// The surfaces to fit to cannot be parted as asked.
    #[error(transparent)]
    Split(#[from] sps_dataset::SplitError),
    /// Something handed in has the wrong shape, number or values.
    #[error(transparent)]
    Input(#[from] Unexpected),
    /// A training came to nothing.
    #[error("{property}, rerun {rerun}: {reason}")]
    Diverged {
        /// The property that has no model.
        property: String,
        /// The number of its rerun.
        rerun: u64,
        /// Why.
        reason: String,
    },
    /// A file of an artefact cannot be read or written.
    #[error("{}: {error}", path.display())]
    File {
        /// Which one.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// An artefact is none of this version, or its files do not belong together.
    #[error("{}: {problem}", path.display())]
    Artefact {
        /// The file that says so.
        path: PathBuf,
        /// What was found and what was expected.
        problem: String,
    },
}

impl From<sps_regress::Error> for Error {
    fn from(error: sps_regress::Error) -> Self {
        Self::Model(error.into())
    }
}

impl Error {
    pub(crate) fn input(
        what: impl fmt::Display,
        found: impl fmt::Display,
        expected: impl fmt::Display,
    ) -> Self {
        Self::Input(Unexpected::new(what, found, expected))
    }

    /// What is wrong with reading or writing a file.
    pub(crate) fn file(path: &Path) -> impl Fn(io::Error) -> Self {
        move |error| Self::File {
            path: path.to_owned(),
            error,
        }
    }

    pub(crate) fn artefact(path: &Path, problem: impl fmt::Display) -> Self {
        Self::Artefact {
            path: path.to_owned(),
            problem: problem.to_string(),
        }
    }
}

/// Something else than was expected.
pub(crate) fn refuse<T>(
    what: impl fmt::Display,
    found: impl fmt::Display,
    expected: impl fmt::Display,
) -> Result<T> {
    Err(Error::input(what, found, expected))
}
