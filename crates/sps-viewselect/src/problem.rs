//! What is to be selected, checked once.

use crate::error::SelectError;
use crate::loss::SetLoss;
use crate::selection::Selection;
use crate::sets::is_distinct;

/// A loss whose views can be selected: at least one view, sets of 1 to N views.
///
/// Selectors take no other options in common than these: whether views must be distinct, and the
/// seed of every draw.
#[derive(Clone, Copy)]
pub struct Problem<'a> {
    loss: &'a dyn SetLoss,
    views: usize,
    picks: usize,
    distinct: bool,
    seed: u64,
}

impl<'a> Problem<'a> {
    /// Repeats allowed, as in the paper (section "Viewpoint Selector Framework": "There are no
    /// constraints between the vectors, therefore allowing repeated viewpoints"), seed 0.
    ///
    /// # Errors
    ///
    /// [`SelectError::NoViews`], [`SelectError::NoPicks`], [`SelectError::TooManyPicks`] (also where
    /// repeats are allowed).
    pub fn new(loss: &'a dyn SetLoss) -> Result<Self, SelectError> {
        let (views, picks) = (loss.views(), loss.picks());
        check_sizes(views, picks)?;
        Ok(Self {
            loss,
            views,
            picks,
            distinct: false,
            seed: 0,
        })
    }

    /// Whether no view may come twice in a set.
    #[must_use]
    pub fn distinct(mut self, distinct: bool) -> Self {
        self.distinct = distinct;
        self
    }

    /// The seed of every draw.
    #[must_use]
    pub fn seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self
    }

    /// Views that there are, N.
    pub fn views(&self) -> usize {
        self.views
    }

    /// Views in a set, M.
    pub fn picks(&self) -> usize {
        self.picks
    }

    /// Whether no view may come twice in a set.
    pub fn is_distinct(&self) -> bool {
        self.distinct
    }

    /// Whether views are distinct where they must be.
    pub(crate) fn allows(&self, set: &[usize]) -> bool {
        !self.distinct || is_distinct(set)
    }

    /// The seed of every draw, for a selector to key its streams by.
    pub fn seed_value(&self) -> u64 {
        self.seed
    }

    /// The loss, for a selector to ask.
    pub fn loss(&self) -> &'a dyn SetLoss {
        self.loss
    }
}

/// Refuses sets that cannot be.
pub(crate) fn check_sizes(views: usize, picks: usize) -> Result<(), SelectError> {
    match (views, picks) {
        (0, _) => Err(SelectError::NoViews),
        (_, 0) => Err(SelectError::NoPicks),
        _ if picks > views => Err(SelectError::TooManyPicks { views, picks }),
        _ => Ok(()),
    }
}

/// A way to select views; also one that is not of this crate.
pub trait Selector: Send + Sync {
    /// Selects one set of views. The same problem and seed give the same picks, whatever the number
    /// of threads.
    ///
    /// # Errors
    ///
    /// [`SelectError::Setting`] if a field of the selector is out of its range,
    /// [`SelectError::Loss`] if the loss fails, [`SelectError::LossOutOfRange`] if it returns NaN or
    /// a number beyond 1e100. Each selector says what else.
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError>;
}
