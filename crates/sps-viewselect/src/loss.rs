//! The one question that a selector asks: the loss of a set of views.

use std::fmt;

use crate::sets::Sets;

/// What a [`SetLoss`] may fail with.
pub type LossError = Box<dyn std::error::Error + Send + Sync>;

/// The loss of a set of M of N views: lower is better.
///
/// A set is ordered: place m of it is slot m of the estimator, so `[3, 8]` and `[8, 3]` may have
/// different losses. A view may come twice, unless the [`Problem`](crate::Problem) asks for
/// distinct views.
///
/// A loss is a pure function: the same set has the same loss every time, whichever sets are asked
/// beside it. Selectors remember losses, ask in parallel, and owe their repeatability to it.
///
/// Sets that follow one another often agree in all slots but one, and
/// [`Exhaustive`](crate::Exhaustive) hands them over in lexicographic order, in blocks of whole
/// runs that share the first M - 1 views. A loss that is a sum of one term per slot and view, and a
/// small head over it, computes the sum over those once per run. The [crate's page](crate) has an
/// example.
pub trait SetLoss: Sync {
    /// Views that there are, N.
    fn views(&self) -> usize;

    /// Views in a set, M.
    fn picks(&self) -> usize;

    /// Writes the loss of every set, in the order of the sets. `losses` is as long as `sets`, and
    /// every set holds [`picks`](Self::picks) views below [`views`](Self::views).
    ///
    /// Called from several threads at once.
    ///
    /// # Errors
    /// Whatever the loss fails with: the selection ends with it.
    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError>;
}

/// A plain function as a [`SetLoss`].
#[derive(Clone)]
pub struct SetFunction<F> {
    views: usize,
    picks: usize,
    function: F,
}

impl<F: Fn(&[usize]) -> f64 + Sync> SetFunction<F> {
    /// `function` gives the loss of one set of `picks` of `views` views.
    pub fn new(views: usize, picks: usize, function: F) -> Self {
        Self {
            views,
            picks,
            function,
        }
    }
}

impl<F> fmt::Debug for SetFunction<F> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("SetFunction")
            .field("views", &self.views)
            .field("picks", &self.picks)
            .finish_non_exhaustive()
    }
}

impl<F: Fn(&[usize]) -> f64 + Sync> SetLoss for SetFunction<F> {
    fn views(&self) -> usize {
        self.views
    }

    fn picks(&self) -> usize {
        self.picks
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        for (set, loss) in sets.iter().zip(losses) {
            *loss = (self.function)(set);
        }
        Ok(())
    }
}
