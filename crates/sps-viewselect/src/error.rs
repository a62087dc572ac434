//! What can go wrong in a selection.

use crate::loss::LossError;

/// Why there is no selection.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SelectError {
    /// The loss knows no views.
    #[error("the loss has 0 views, expected at least 1")]
    NoViews,
    /// The loss takes no views.
    #[error("the loss takes sets of 0 views, expected at least 1")]
    NoPicks,
    /// More views are wanted than there are.
    #[error("sets of {picks} views are wanted of {views} views, expected at most {views}")]
    TooManyPicks {
        /// Views that there are, N.
        views: usize,
        /// Views in a set, M.
        picks: usize,
    },
    /// A setting is out of its range.
    #[error("`{field}` is {found}, expected {expected}")]
    Setting {
        /// The field's name.
        field: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        expected: &'static str,
    },
    /// There are more sets than an exhaustive search is allowed to go through.
    #[error(
        "there are {sets} sets of {picks} of {views} views, expected at most {limit}: raise `limit`, or search"
    )]
    TooManySets {
        /// Views that there are, N.
        views: usize,
        /// Views in a set, M.
        picks: usize,
        /// How many sets there are, in words where the number does not fit.
        sets: String,
        /// The most that are allowed.
        limit: u64,
    },
    /// The loss itself failed.
    #[error("the loss of {sets} sets, the first of them {first:?}, failed")]
    Loss {
        /// How many sets were asked for in the call.
        sets: usize,
        /// The first of them.
        first: Vec<usize>,
        /// What the loss said.
        source: LossError,
    },
    /// The loss of a set is NaN, infinite or beyond 1e100.
    #[error("the loss of the set {set:?} is {loss}, expected a number within 1e100 of 0")]
    LossOutOfRange {
        /// The set, in the order of its slots.
        set: Vec<usize>,
        /// What the loss returned.
        loss: f64,
    },
    /// A slice of sets does not hold whole sets.
    #[error("the slice of sets has {found} elements, expected {expected}")]
    Length {
        /// Its length.
        found: usize,
        /// The length of the whole sets in it.
        expected: usize,
    },
}

/// Refuses a setting that does not fit.
#[expect(clippy::needless_pass_by_value, reason = "numbers, mostly")]
pub(crate) fn require(
    fits: bool,
    field: &'static str,
    found: impl ToString,
    expected: &'static str,
) -> Result<(), SelectError> {
    if fits {
        return Ok(());
    }
    Err(SelectError::Setting {
        field,
        found: found.to_string(),
        expected,
    })
}

/// Refuses a count of 0.
pub(crate) fn require_some<T: ToString + Default + PartialEq>(
    field: &'static str,
    found: T,
) -> Result<(), SelectError> {
    require(found != T::default(), field, found, "at least 1")
}

/// Refuses a number that is not above 0.
pub(crate) fn require_positive(field: &'static str, found: f64) -> Result<(), SelectError> {
    let fits = found > 0.0 && found.is_finite();
    require(fits, field, found, "a positive number")
}

/// Refuses a number below 0.
pub(crate) fn require_not_negative(field: &'static str, found: f64) -> Result<(), SelectError> {
    let fits = found >= 0.0 && found.is_finite();
    require(fits, field, found, "0 or a positive number")
}
