//! Asks for losses, counts, remembers and checks.

use std::collections::HashMap;
use std::time::Instant;

use rayon::prelude::*;

use crate::error::SelectError;
use crate::problem::Problem;
use crate::selection::{CurvePoint, Selection};
use crate::sets::{SetList, Sets};
use crate::vector::mean;

/// Sets per call of the loss in a search. Fixed, so that calls do not depend on the number of
/// threads; small, so that a batch of a policy occupies several.
const SETS_PER_CALL: usize = 32;

/// Squares of losses, sums of squares and the moments of Adam stay finite.
const LARGEST_LOSS: f64 = 1e100;

/// The loss of every set, each within [`LARGEST_LOSS`] of 0.
pub(crate) fn checked_losses(
    problem: &Problem<'_>,
    sets: Sets<'_>,
    losses: &mut [f64],
) -> Result<(), SelectError> {
    let Some(first) = sets.iter().next() else {
        return Ok(());
    };
    let asked = problem.loss().losses(sets, losses);
    asked.map_err(|source| SelectError::Loss {
        sets: sets.len(),
        first: first.to_vec(),
        source,
    })?;
    for (set, loss) in sets.iter().zip(losses) {
        if loss.is_nan() || loss.abs() > LARGEST_LOSS {
            return Err(SelectError::LossOutOfRange {
                set: set.to_vec(),
                loss: *loss,
            });
        }
        // Minus zero becomes zero: the two are a tie.
        *loss += 0.0;
    }
    Ok(())
}

/// One selection's account with the loss.
pub(crate) struct Evaluator<'a> {
    problem: Problem<'a>,
    start: Instant,
    memory: HashMap<Box<[usize]>, f64>,
    asked: u64,
    best: f64,
    curve: Vec<CurvePoint>,
}

impl<'a> Evaluator<'a> {
    pub(crate) fn new(problem: &Problem<'a>) -> Self {
        Self {
            problem: *problem,
            start: Instant::now(),
            memory: HashMap::new(),
            asked: 0,
            best: f64::INFINITY,
            curve: Vec::new(),
        }
    }

    /// Sets asked for so far, repeats included.
    pub(crate) fn asked(&self) -> u64 {
        self.asked
    }

    /// Whether the loss of a set was asked for before.
    pub(crate) fn knows(&self, set: &[usize]) -> bool {
        self.memory.contains_key(set)
    }

    /// The loss of every set, as one round of the search.
    pub(crate) fn losses(&mut self, sets: Sets<'_>) -> Result<Vec<f64>, SelectError> {
        self.compute_unknown(sets)?;
        let losses: Vec<f64> = sets.iter().map(|set| self.memory[set]).collect();
        self.asked += losses.len() as u64;
        if !losses.is_empty() {
            self.best = losses.iter().copied().fold(self.best, f64::min);
            self.curve.push(CurvePoint {
                evaluations: self.asked,
                mean: mean(&losses),
                best: self.best,
            });
        }
        Ok(losses)
    }

    /// The report. Picks whose loss is not known yet cost one more evaluation.
    pub(crate) fn finish(mut self, picks: Vec<usize>) -> Result<Selection, SelectError> {
        let known = self.memory.get(picks.as_slice()).copied();
        let loss = match known {
            Some(loss) => loss,
            None => self.losses(Sets::new(&picks, self.problem.picks())?)?[0],
        };
        Ok(Selection {
            picks,
            loss,
            curve: self.curve,
            evaluations: self.asked,
            computed: self.memory.len() as u64,
            seconds: self.start.elapsed().as_secs_f64(),
        })
    }

    fn compute_unknown(&mut self, sets: Sets<'_>) -> Result<(), SelectError> {
        let mut unknown = SetList::new(self.problem.picks());
        for set in sets {
            if !self.memory.contains_key(set) {
                // NaN until the loss is there: no loss that is returned is NaN.
                self.memory.insert(set.into(), f64::NAN);
                unknown.push(set);
            }
        }
        let unknown = unknown.as_sets();
        let mut losses = vec![0.0; unknown.len()];
        let picks = self.problem.picks();
        unknown
            .as_flat()
            .par_chunks(SETS_PER_CALL * picks)
            .zip(losses.par_chunks_mut(SETS_PER_CALL))
            .map(|(flat, losses)| checked_losses(&self.problem, Sets::new(flat, picks)?, losses))
            // Of several failures the first, whichever thread was faster.
            .collect::<Vec<_>>()
            .into_iter()
            .collect::<Result<(), _>>()?;
        for (set, loss) in unknown.iter().zip(losses) {
            self.memory.insert(set.into(), loss);
        }
        Ok(())
    }
}
