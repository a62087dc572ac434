use std::fmt;

use sps_base::Unexpected;

use crate::weights::WeightsError;

/// The result of everything in this crate that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong in this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A weights file could not be read, or does not fit the network.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// An observer has stopped the training of heads.
    #[cfg(feature = "heads")]
    #[error("the training was stopped")]
    Stopped,
    /// The kernels cannot have a tensor.
    #[error(transparent)]
    Kernels(sps_kernels::Error),
    /// A table, a plan or a regression is not what it should be.
    #[cfg(feature = "heads")]
    #[error(transparent)]
    Regression(sps_regress::Error),
    /// A tensor, an image or a table handed in has the wrong shape, type or values; a setting is out of its
    /// range.
    #[error(transparent)]
    Input(#[from] Unexpected),
    /// No encoder has this name.
    #[error("unknown encoder {found:?}, expected one of {expected}")]
    UnknownEncoder {
        /// The name asked for.
        found: String,
        /// The names there are.
        expected: String,
    },
    /// An encoder without weights that come with this crate.
    #[error("{encoder} has no built-in weights, only {expected} has; expected a file of weights")]
    NoBuiltInWeights {
        /// The encoder asked for.
        encoder: &'static str,
        /// The one that has them.
        expected: &'static str,
    },
    /// An image to train on could not be had.
    #[error("image {index}: {source}")]
    Image {
        /// Which one.
        index: usize,
        /// Why.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The tensor library failed.
    #[error("tensor operation: {0}")]
    Tensor(#[from] candle_core::Error),
}

impl Error {
    pub(crate) fn input(
        what: &'static str,
        found: impl fmt::Display,
        expected: impl fmt::Display,
    ) -> Self {
        Self::Input(Unexpected::new(what, found, expected))
    }
}

/// Refuses a setting, by its key, that does not hold what is `expected`.
#[cfg(feature = "heads")]
pub(crate) fn require(
    holds: bool,
    key: &'static str,
    found: impl fmt::Display,
    expected: impl fmt::Display,
) -> Result<()> {
    if holds {
        return Ok(());
    }
    Err(Error::input(key, found, expected))
}

/// What the kernels refuse is what this crate refuses.
impl From<sps_kernels::Error> for Error {
    fn from(error: sps_kernels::Error) -> Self {
        match error {
            sps_kernels::Error::Input(input) => Self::Input(input),
            error => Self::Kernels(error),
        }
    }
}

/// An error of this crate that went through a regressor comes out as it was.
#[cfg(feature = "heads")]
impl From<sps_regress::Error> for Error {
    fn from(error: sps_regress::Error) -> Self {
        match error {
            sps_regress::Error::Other(other) => match other.downcast() {
                Ok(own) => *own,
                Err(other) => Self::Regression(sps_regress::Error::Other(other)),
            },
            error => Self::Regression(error),
        }
    }
}

#[cfg(feature = "heads")]
impl From<Error> for sps_regress::Error {
    fn from(error: Error) -> Self {
        match error {
            Error::Regression(error) => error,
            error => Self::Other(error.into()),
        }
    }
}
