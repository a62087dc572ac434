//! What is to be selected, checked once.

use std::fmt;

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

impl fmt::Debug for Problem<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("Problem")
            .field("views", &self.views)
            .field("picks", &self.picks)
            .field("distinct", &self.distinct)
            .field("seed", &self.seed)
            .finish_non_exhaustive()
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
///
/// ```
/// use std::time::Instant;
///
/// use sps_viewselect::{CurvePoint, Problem, SelectError, Selection, Selector, SetFunction, Sets};
///
/// /// The first views there are.
/// struct First;
///
/// impl Selector for First {
///     fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError> {
///         let start = Instant::now();
///         let picks: Vec<usize> = (0..problem.picks()).collect();
///         let mut loss = [0.0];
///         let sets = Sets::new(&picks, problem.picks())?;
///         problem.loss().losses(sets, &mut loss).map_err(|source| SelectError::Loss {
///             sets: 1,
///             first: picks.clone(),
///             source,
///         })?;
///         Ok(Selection {
///             picks,
///             loss: loss[0],
///             curve: vec![CurvePoint { evaluations: 1, mean: loss[0], best: loss[0] }],
///             evaluations: 1,
///             computed: 1,
///             seconds: start.elapsed().as_secs_f64(),
///         })
///     }
/// }
///
/// let loss = SetFunction::new(9, 2, |set: &[usize]| (set[0] + set[1]) as f64);
/// assert_eq!(First.select(&Problem::new(&loss)?)?.loss, 1.0);
/// # Ok::<(), SelectError>(())
/// ```
pub trait Selector: Send + Sync {
    /// Selects one set of views. The same problem and seed give the same picks, whatever the number
    /// of threads.
    ///
    /// # Errors
    /// [`SelectError::Setting`] if a field of the selector is out of its range,
    /// [`SelectError::Loss`] if the loss fails, [`SelectError::LossOutOfRange`] if it returns NaN or
    /// a number beyond 1e100. Each selector says what else.
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError>;
}
