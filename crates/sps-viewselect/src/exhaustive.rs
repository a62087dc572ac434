//! The true optimum.

use std::time::Instant;

use rayon::prelude::*;

use crate::error::{SelectError, require};
use crate::evaluator::checked_losses;
use crate::problem::{Problem, Selector};
use crate::selection::{CurvePoint, Selection};
use crate::sets::{SetList, is_distinct};
use crate::vector::mean;

/// Sets of up to this many views are always gone through, whatever their number.
const ALWAYS: usize = 3;

/// Every set, in lexicographic order; of several optima the lexicographically first.
///
/// Sets are handed to the loss in blocks, several blocks in parallel. A block is one or more whole
/// runs, and a run is all sets that share the first M - 1 views. Memory stays below
/// `threads * max(block, N) * (8 M + 8)` bytes, and 24 bytes a block for the curve.
///
/// For M up to 3 every problem is gone through; beyond, an N^M above `limit` is
/// [`SelectError::TooManySets`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(
    feature = "serde",
    serde(default, deny_unknown_fields, rename_all = "kebab-case")
)]
pub struct Exhaustive {
    /// Sets per call of the loss, rounded down to whole runs, at least one run. Default 4096: large
    /// enough that a loss can walk over its surfaces outside and over the sets inside, so that a
    /// surface's terms stay in the cache.
    pub block: usize,
    /// The largest N^M for M above 3. Default 2^24, 17 million.
    pub limit: u64,
}

impl Default for Exhaustive {
    fn default() -> Self {
        Self {
            block: 4096,
            limit: 1 << 24,
        }
    }
}

impl Selector for Exhaustive {
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError> {
        require(self.block > 0, "block", self.block, "at least 1")?;
        let start = Instant::now();
        let runs = self.runs(problem)?;
        let runs_per_block = (self.block / problem.views()).max(1) as u64;
        let blocks: Vec<Option<Block>> = (0..runs.div_ceil(runs_per_block))
            .into_par_iter()
            .map(|block| {
                let first = block * runs_per_block;
                best_of_runs(problem, first..(first + runs_per_block).min(runs))
            })
            .collect::<Result<_, _>>()?;
        Ok(report(blocks.into_iter().flatten(), start))
    }
}

impl Exhaustive {
    /// How many sets will be evaluated: N^M, or N! / (N - M)! of distinct views.
    ///
    /// # Errors
    ///
    /// [`SelectError::TooManySets`].
    pub fn evaluations(&self, problem: &Problem<'_>) -> Result<u64, SelectError> {
        let runs = self.runs(problem)?;
        let (views, picks) = (problem.views() as u64, problem.picks() as u64);
        Ok(if problem.is_distinct() {
            (0..picks).map(|taken| views - taken).product()
        } else {
            runs * views
        })
    }

    /// N^(M - 1), if N^M is allowed.
    fn runs(&self, problem: &Problem<'_>) -> Result<u64, SelectError> {
        let (views, picks) = (problem.views(), problem.picks());
        let sets = (views as u64).checked_pow(u32::try_from(picks).unwrap_or(u32::MAX));
        match sets {
            Some(sets) if picks <= ALWAYS || sets <= self.limit => Ok(sets / views as u64),
            _ => Err(SelectError::TooManySets {
                views,
                picks,
                sets: sets.map_or_else(|| "more than 2^64".to_owned(), |sets| sets.to_string()),
                limit: self.limit,
            }),
        }
    }
}

/// What is kept of a block.
struct Block {
    sets: u64,
    mean: f64,
    loss: f64,
    picks: Vec<usize>,
}

fn best_of_runs(
    problem: &Problem<'_>,
    runs: std::ops::Range<u64>,
) -> Result<Option<Block>, SelectError> {
    let list = sets_of_runs(problem, runs);
    let sets = list.as_sets();
    let mut losses = vec![0.0; sets.len()];
    checked_losses(problem, sets, &mut losses)?;
    let lowest = sets
        .iter()
        .zip(&losses)
        // The first of equals, as `min_by` has it.
        .min_by(|(_, loss), (_, lowest)| loss.total_cmp(lowest));
    Ok(lowest.map(|(set, &loss)| Block {
        sets: losses.len() as u64,
        mean: mean(&losses),
        loss,
        picks: set.to_vec(),
    }))
}

fn sets_of_runs(problem: &Problem<'_>, runs: std::ops::Range<u64>) -> SetList {
    let mut sets = SetList::new(problem.picks());
    let mut set = vec![0; problem.picks()];
    let last = problem.picks() - 1;
    for run in runs {
        // The first M - 1 views are the digits of the run's number.
        let mut rest = run;
        for view in set[..last].iter_mut().rev() {
            *view = (rest % problem.views() as u64) as usize;
            rest /= problem.views() as u64;
        }
        for view in 0..problem.views() {
            set[last] = view;
            if !problem.is_distinct() || is_distinct(&set) {
                sets.push(&set);
            }
        }
    }
    sets
}

/// Blocks in order; there is at least one, since M is at most N.
fn report(blocks: impl Iterator<Item = Block>, start: Instant) -> Selection {
    let mut selection = Selection {
        picks: Vec::new(),
        loss: f64::INFINITY,
        curve: Vec::new(),
        evaluations: 0,
        computed: 0,
        seconds: 0.0,
    };
    for block in blocks {
        if block.loss < selection.loss {
            selection.loss = block.loss;
            selection.picks = block.picks;
        }
        selection.evaluations += block.sets;
        selection.curve.push(CurvePoint {
            evaluations: selection.evaluations,
            mean: block.mean,
            best: selection.loss,
        });
    }
    selection.computed = selection.evaluations;
    selection.seconds = start.elapsed().as_secs_f64();
    selection
}
