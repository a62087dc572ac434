//! The true optimum.

use std::ops::Range;
use std::time::Instant;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::{SelectError, require};
use crate::evaluator::checked_losses;
use crate::problem::{Problem, Selector};
use crate::selection::{CurvePoint, Selection};
use crate::sets::{SetList, is_distinct};
use crate::vector::mean;

/// Far beyond what any loss gains from.
const LARGEST_BLOCK: usize = 1 << 24;

/// Blocks whose results are kept side by side until they are in the curve.
const BLOCKS_AT_ONCE: u64 = 1024;

/// Every set, in lexicographic order; of several optima the lexicographically first.
///
/// Sets are handed to the loss in blocks, several blocks in parallel. A block is one or more whole
/// runs, and a run is all sets that share the first M - 1 views. Besides what the loss takes, memory
/// stays below `max(block, N) * (8 M + 8)` bytes a thread and 1024 results of blocks. What grows with
/// the problem is the curve alone: a point of 24 bytes a block, and up to three times that at the
/// moments when it is moved to a larger place. (A loss that starts work on rayon's pool itself lets a
/// thread begin further blocks while it waits.)
///
/// An N^M above `limit` is [`SelectError::TooManySets`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Exhaustive {
    /// Sets per call of the loss, 1 to 2^24, rounded down to whole runs, at least one run. Default
    /// 4096: large enough that a loss can walk over its surfaces outside and over the sets inside, so
    /// that a surface's terms stay in the cache.
    pub block: usize,
    /// The largest N^M. Default 2^24, 17 million: three of 256 views, two of 4096.
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
        let fits = (1..=LARGEST_BLOCK).contains(&self.block);
        require(fits, "block", self.block, "1 to 16777216")?;
        let start = Instant::now();
        let runs = self.runs(problem)?;
        let runs_per_block = (self.block / problem.views()).max(1) as u64;
        let blocks = runs.div_ceil(runs_per_block);
        let mut selection = Selection {
            picks: Vec::new(),
            loss: f64::INFINITY,
            curve: Vec::new(),
            evaluations: 0,
            computed: 0,
            seconds: 0.0,
        };
        for first in (0..blocks).step_by(BLOCKS_AT_ONCE as usize) {
            let found: Vec<Option<Block>> = (first..(first + BLOCKS_AT_ONCE).min(blocks))
                .into_par_iter()
                .map(|block| {
                    let first = block * runs_per_block;
                    best_of_runs(problem, first..(first + runs_per_block).min(runs))
                })
                .collect::<Result<_, _>>()?;
            for block in found.into_iter().flatten() {
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
        }
        selection.computed = selection.evaluations;
        selection.seconds = start.elapsed().as_secs_f64();
        Ok(selection)
    }
}

impl Exhaustive {
    /// N^(M - 1), if N^M is allowed.
    fn runs(&self, problem: &Problem<'_>) -> Result<u64, SelectError> {
        let (views, picks) = (problem.views(), problem.picks());
        let sets = (views as u64).checked_pow(u32::try_from(picks).unwrap_or(u32::MAX));
        match sets {
            Some(sets) if sets <= self.limit => Ok(sets / views as u64),
            _ => Err(SelectError::TooManySets {
                views,
                picks,
                sets: sets.map_or_else(|| "more than 2^64".to_owned(), |sets| sets.to_string()),
                limit: self.limit,
            }),
        }
    }
}

/// What is kept of a block of runs.
struct Block {
    sets: u64,
    mean: f64,
    loss: f64,
    picks: Vec<usize>,
}

fn best_of_runs(problem: &Problem<'_>, runs: Range<u64>) -> Result<Option<Block>, SelectError> {
    let list = sets_of_runs(problem, runs);
    let sets = list.as_sets();
    let mut losses = vec![0.0; sets.len()];
    checked_losses(problem, sets, &mut losses)?;
    // The first of equals, as `min_by` has it.
    let lowest = sets.iter().zip(&losses);
    let lowest = lowest.min_by(|(_, loss), (_, lowest)| loss.total_cmp(lowest));
    Ok(lowest.map(|(set, &loss)| Block {
        sets: losses.len() as u64,
        mean: mean(&losses),
        loss,
        picks: set.to_vec(),
    }))
}

fn sets_of_runs(problem: &Problem<'_>, runs: Range<u64>) -> SetList {
    let most = (runs.end - runs.start) as usize * problem.views();
    let mut sets = SetList::with_capacity(problem.picks(), most);
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
            // Asked in place: `Problem::allows` for each set takes 2 % more instructions.
            if !problem.is_distinct() || is_distinct(&set) {
                sets.push(&set);
            }
        }
    }
    sets
}
