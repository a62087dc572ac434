use std::fmt;

use sps_base::Unexpected;

/// What can go wrong.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Input does not fit.
    #[error(transparent)]
    Input(#[from] Unexpected),
    /// A network's tensor could not be had.
    #[error("{0}")]
    Tensor(#[source] Box<dyn std::error::Error + Send + Sync>),
}

/// A value, or what went wrong.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    pub(crate) fn input(
        what: &'static str,
        found: impl fmt::Display,
        expected: impl fmt::Display,
    ) -> Self {
        Self::Input(Unexpected::new(what, found, expected))
    }
}

/// An image of which a layer leaves nothing.
pub(crate) fn too_small(size: [usize; 3]) -> Error {
    Error::input("images", format_args!("a map of {size:?}"), "larger ones")
}
