use std::fmt;

/// What can go wrong.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Input does not fit.
    #[error("{what}: found {found}, expected {expected}")]
    Input {
        /// Which input.
        what: &'static str,
        /// What it was.
        found: String,
        /// What it must be.
        expected: String,
    },
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
        Self::Input {
            what,
            found: found.to_string(),
            expected: expected.to_string(),
        }
    }
}

/// An image of which a layer leaves nothing.
pub(crate) fn too_small(size: [usize; 3]) -> Error {
    Error::input("images", format_args!("a map of {size:?}"), "larger ones")
}
