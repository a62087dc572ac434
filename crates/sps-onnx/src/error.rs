use std::fmt;

use sps_base::Unexpected;

/// Why a file, or an image, was refused.
#[derive(Debug, thiserror::Error)]
#[error("{file}: {kind}")]
pub struct OnnxError {
    file: String,
    kind: ErrorKind,
}

impl OnnxError {
    pub(crate) fn new(file: &str, kind: ErrorKind) -> Self {
        Self {
            file: file.to_owned(),
            kind,
        }
    }

    /// What is wrong.
    pub fn kind(&self) -> &ErrorKind {
        &self.kind
    }
}

/// What is wrong with a file, or with an image.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// This build reads no ONNX files.
    #[error("found an ONNX file, expected a build with the feature `onnx`, which reads them")]
    NotBuilt,
    /// A setting or an image that does not fit the file, or a file that is not as it must be.
    #[error(transparent)]
    Input(#[from] Unexpected),
    /// The network cannot be built or run: an operator that is not known, by its name, or one that was given
    /// other than it takes.
    #[error("{0}")]
    Network(String),
    /// The library that runs the network panicked on it.
    #[error("the network cannot be run: {0}")]
    Panicked(String),
}

impl ErrorKind {
    pub(crate) fn input(
        what: impl fmt::Display,
        found: impl fmt::Display,
        expected: impl fmt::Display,
    ) -> Self {
        Self::Input(Unexpected::new(what, found, expected))
    }
}
