//! Forward selection with swaps.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::baselines::{at_centres, best_of};
use crate::error::{SelectError, require_some};
use crate::evaluator::Evaluator;
use crate::problem::{Problem, Selector};
use crate::selection::Selection;
use crate::sets::SetList;
use crate::stream::{Purpose, Stream};

/// Forward selection with swaps, from several starts.
///
/// The loss is known for whole sets only, so slots cannot be filled one by one from nothing. Each
/// start is a whole set (the equidistant one, then random ones), and its slots are chosen anew one
/// after the other, each with the best view given the others, until no slot changes. Then the best
/// few views of each slot are tried two slots at a time, which also exchanges the views of two
/// slots; a better set is taken as a new beginning. The best of all starts is picked.
///
/// What is left is a local optimum: no change of one slot lowers its loss. With `pair_width` of N
/// or more, no change of two does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Greedy {
    /// Starts. Default 8.
    pub starts: usize,
    /// Views per slot that are tried in pairs; 0 tries none. Default 16: M (M - 1) / 2 * 256
    /// evaluations a round.
    pub pair_width: usize,
}

impl Default for Greedy {
    fn default() -> Self {
        Self {
            starts: 8,
            pair_width: 16,
        }
    }
}

impl Selector for Greedy {
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError> {
        require_some("starts", self.starts)?;
        let mut search = Search {
            problem,
            evaluator: Evaluator::new(problem),
            pair_width: self.pair_width,
        };
        let mut optima = SetList::new(problem.picks());
        for start in 0..self.starts {
            optima.push(&search.local_optimum(start_set(problem, start as u64))?);
        }
        let losses = search.evaluator.losses(optima.as_sets())?;
        let picks = best_of(optima.as_sets(), &losses);
        search.evaluator.finish(picks)
    }
}

fn start_set(problem: &Problem<'_>, start: u64) -> Vec<usize> {
    if start == 0 {
        return at_centres(problem.views(), problem.picks());
    }
    Stream::new(problem.seed_value(), Purpose::GreedyStarts, start).set(problem)
}

struct Search<'p, 'l> {
    problem: &'p Problem<'l>,
    evaluator: Evaluator<'l>,
    pair_width: usize,
}

/// A set, and for each slot the best views given the other slots.
struct Optimum {
    set: Vec<usize>,
    best_views: Vec<Vec<usize>>,
}

impl Search<'_, '_> {
    fn local_optimum(&mut self, mut set: Vec<usize>) -> Result<Vec<usize>, SelectError> {
        loop {
            let optimum = self.sweep_until_still(set)?;
            let better = self.best_of_pairs(&optimum)?;
            if better == optimum.set {
                return Ok(better);
            }
            set = better;
        }
    }

    /// Chooses slot after slot anew until a whole round changes none.
    fn sweep_until_still(&mut self, mut set: Vec<usize>) -> Result<Optimum, SelectError> {
        loop {
            let mut still = true;
            let mut best_views = Vec::with_capacity(set.len());
            for slot in 0..set.len() {
                let views = self.ranked_views(&set, slot)?;
                still &= views[0] == set[slot];
                set[slot] = views[0];
                best_views.push(views);
            }
            if still {
                return Ok(Optimum { set, best_views });
            }
        }
    }

    /// The best views of a slot given the other slots, best first: `pair_width` of them, at least
    /// one. The present view comes before others that are no better.
    fn ranked_views(&mut self, set: &[usize], slot: usize) -> Result<Vec<usize>, SelectError> {
        let mut candidates = SetList::new(set.len());
        let mut candidate = set.to_vec();
        for view in 0..self.problem.views() {
            candidate[slot] = view;
            self.push(&mut candidates, &candidate);
        }
        let losses = self.evaluator.losses(candidates.as_sets())?;
        let views = candidates.as_sets().iter().map(|candidate| candidate[slot]);
        let mut ranked: Vec<(usize, f64)> = views.zip(losses).collect();
        let moves = |view: usize| view != set[slot];
        // Of equals, the view that is there already, then the lower one: they come in order, and the sort is stable.
        ranked.sort_by(|a, b| a.1.total_cmp(&b.1).then(moves(a.0).cmp(&moves(b.0))));
        ranked.truncate(self.pair_width.max(1));
        Ok(ranked.into_iter().map(|(view, _)| view).collect())
    }

    /// The best of the optimum and all sets that differ from it in two slots, by one of each
    /// slot's best views or by the two views exchanged.
    fn best_of_pairs(&mut self, optimum: &Optimum) -> Result<Vec<usize>, SelectError> {
        let mut candidates = SetList::new(optimum.set.len());
        candidates.push(&optimum.set);
        if self.pair_width > 0 {
            for second in 1..optimum.set.len() {
                for first in 0..second {
                    self.push_pairs(&mut candidates, optimum, first, second);
                }
            }
        }
        let losses = self.evaluator.losses(candidates.as_sets())?;
        // A tie is no reason to go on.
        if losses.iter().all(|&loss| loss >= losses[0]) {
            return Ok(optimum.set.clone());
        }
        Ok(best_of(candidates.as_sets(), &losses))
    }

    fn push_pairs(&self, candidates: &mut SetList, optimum: &Optimum, first: usize, second: usize) {
        let here = (optimum.set[first], optimum.set[second]);
        let mut pairs = BTreeSet::from([(here.1, here.0)]);
        for &one in &optimum.best_views[first] {
            pairs.extend(optimum.best_views[second].iter().map(|&other| (one, other)));
        }
        pairs.remove(&here);
        let mut candidate = optimum.set.clone();
        for (one, other) in pairs {
            candidate[first] = one;
            candidate[second] = other;
            self.push(candidates, &candidate);
        }
    }

    fn push(&self, candidates: &mut SetList, candidate: &[usize]) {
        if self.problem.allows(candidate) {
            candidates.push(candidate);
        }
    }
}
