use std::fmt;

use sps_base::Unexpected;

/// The result of everything in this crate that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong in this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A table, setting or file that was handed in has the wrong shape or values.
    #[error(transparent)]
    Input(#[from] Unexpected),
    /// The plan names something that the data does not have, or contradicts itself.
    #[error("training plan: {0}")]
    Plan(Unexpected),
    /// None of a rerun's training surfaces has a reading of the property.
    #[error("no training surface of rerun {rerun} has a reading of {property}")]
    NotMeasured {
        /// The property.
        property: String,
        /// The rerun's number.
        rerun: u64,
    },
    /// Kept models could not be read.
    #[error("{name}: {source}")]
    Kept {
        /// What stands for their bytes.
        name: String,
        /// Why.
        source: Box<Self>,
    },
    /// What a [`Regressor`](crate::Regressor) of another crate says.
    #[error(transparent)]
    Other(Box<dyn std::error::Error + Send + Sync>),
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
