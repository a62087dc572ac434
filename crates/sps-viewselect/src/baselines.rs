//! Selections that learn nothing: random, equidistant, nadir.

use serde::{Deserialize, Serialize};

use crate::error::{SelectError, require, require_some};
use crate::evaluator::Evaluator;
use crate::problem::{Problem, Selector};
use crate::selection::Selection;
use crate::sets::{SetList, Sets};
use crate::stream::{Purpose, Stream};

/// Random sets, every one equally likely: one, or the best of several (random search).
///
/// The first point of the curve holds the mean loss of the draws: with many of them, the loss of a
/// random set that [`Selection::regret`] wants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Random {
    /// Sets drawn, of which the best is picked. 1, the default, is the paper's "random".
    pub draws: usize,
}

impl Default for Random {
    fn default() -> Self {
        Self { draws: 1 }
    }
}

impl Selector for Random {
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError> {
        require_some("draws", self.draws)?;
        let mut evaluator = Evaluator::new(problem);
        let mut sets = SetList::new(problem.picks());
        let mut stream = Stream::new(problem.seed_value(), Purpose::RandomSets, 0);
        sets.extend((0..self.draws).map(|_| stream.set(problem)));
        let losses = evaluator.losses(sets.as_sets())?;
        let picks = best_of(sets.as_sets(), &losses);
        evaluator.finish(picks)
    }
}

/// The set of lowest loss, of several the lexicographically first. There is at least one.
pub(crate) fn best_of(sets: Sets<'_>, losses: &[f64]) -> Vec<usize> {
    sets.iter()
        .zip(losses)
        .min_by(|(set, loss), (other, lowest)| loss.total_cmp(lowest).then_with(|| set.cmp(other)))
        .map_or_else(Vec::new, |(set, _)| set.to_vec())
}

/// A fixed interval between the picked views, which are always distinct and in increasing order. It is
/// counted in views: where their angles are uneven, so are those of the picked ones.
///
/// The paper says "sampling at a fixed interval (equidistant)" and no more (section "Viewpoint
/// Selector Framework"): neither where the first view lies nor where the last. Both readings of
/// [`EquidistantAt`] are that. Centres are the default: the view farthest from any picked one is as
/// near as it can be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Equidistant {
    /// Where the views lie. Default [`EquidistantAt::Centres`].
    pub at: EquidistantAt,
}

/// Where equidistant views lie among all N.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EquidistantAt {
    /// The views are cut into M equal parts, and the middle view of each is picked (of two middle
    /// views the lower).
    #[default]
    Centres,
    /// The first view, the last, and those that cut what lies between into M - 1 equal parts (of
    /// two nearest views the lower). One view alone is the middle one, as with centres.
    Ends,
}

impl Selector for Equidistant {
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError> {
        let (views, picks) = (problem.views(), problem.picks());
        Evaluator::new(problem).finish(match self.at {
            EquidistantAt::Centres => at_centres(views, picks),
            EquidistantAt::Ends => at_ends(views, picks),
        })
    }
}

/// The middles of `picks` equal parts of `views` views, in increasing order; `picks` is at most
/// `views`.
///
/// The middle of part i of M is `(2i + 1) N / (2M) - 1/2`, here rounded half down.
pub(crate) fn at_centres(views: usize, picks: usize) -> Vec<usize> {
    let (views, parts) = (views as u128, picks as u128);
    (0..parts)
        .map(|part| (((2 * part + 1) * views - 1) / (2 * parts)) as usize)
        .collect()
}

/// `picks` of `views` views from the first to the last, in increasing order; `picks` is at most
/// `views`.
///
/// View i of M is `i (N - 1) / (M - 1)`, here rounded half down.
fn at_ends(views: usize, picks: usize) -> Vec<usize> {
    if picks < 2 {
        return at_centres(views, picks);
    }
    let (last, intervals) = (views as u128 - 1, picks as u128 - 1);
    (0..=intervals)
        .map(|place| ((2 * place * last + intervals - 1) / (2 * intervals)) as usize)
        .collect()
}

/// Straight down: the nadir view in every slot, or with distinct views the M nearest to it in the order
/// of the views, nearest first (of two equally near the lower).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Nadir {
    /// The view that looks straight down. A problem knows no angles: `None`, the default, is the
    /// middle one (of two the lower), which is right where as many views lie to either side.
    pub view: Option<usize>,
}

impl Selector for Nadir {
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError> {
        let nadir = self.view.unwrap_or((problem.views() - 1) / 2);
        require(nadir < problem.views(), "view", nadir, "a view that exists")?;
        let picks = if problem.is_distinct() {
            nearest(nadir, problem.views(), problem.picks())
        } else {
            vec![nadir; problem.picks()]
        };
        Evaluator::new(problem).finish(picks)
    }
}

fn nearest(nadir: usize, views: usize, picks: usize) -> Vec<usize> {
    let mut by_distance: Vec<usize> = (0..views).collect();
    by_distance.sort_by_key(|&view| (view.abs_diff(nadir), view));
    by_distance.truncate(picks);
    by_distance
}
