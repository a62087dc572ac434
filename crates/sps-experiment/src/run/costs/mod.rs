//! What one estimate costs, measured without the cache.

mod estimate;
mod turn;

use anyhow::Result;
use sps_dataset::Source;

use super::results::MethodRow;
use super::{Splits, Stage};
use crate::config::Looks;
use crate::progress::{Progress, ensure_wanted};
use turn::Turn;

/// How often each surface is estimated at most.
const ROUNDS: usize = 5;

/// Estimates properties of some held-out surfaces one by one, from the frame on: those together
/// that look at the same views. Of a method that looks at one view after the other, one property,
/// at each number of views; these are weighed by how often the method stopped there. One that looks at
/// nothing costs nothing.
///
/// The methods take turns, round by round: what else the machine does comes and goes within
/// seconds, and falls on all of them alike. The time does not depend on what the weights are, so a
/// model of each method's shape is fitted to a few surfaces for it: the run's own models need not
/// be kept.
pub(super) fn measure(
    source: &dyn Source,
    splits: &Splits,
    stage: &Stage,
    rows: &mut [MethodRow<'_>],
) -> Result<()> {
    let looks = |row: &&mut MethodRow<'_>| row.method.looks != Looks::Nothing;
    let rows: Vec<_> = rows.iter_mut().filter(looks).collect();
    let turns = rows.iter();
    let turns = turns.map(|row| Turn::new(source, splits, stage, row));
    let mut turns = turns.collect::<Result<Vec<_>>>()?;
    // Memory made ready and simulated surfaces built, so that the first pays no more than others.
    for turn in &turns {
        turn.pass()?;
    }
    let progress = Progress::new("estimates timed", ROUNDS * turns.len());
    for _ in 0..ROUNDS {
        for turn in &mut turns {
            turn.take()?;
            progress.advance(1);
            ensure_wanted()?;
        }
    }
    for (row, turn) in rows.into_iter().zip(turns) {
        row.costs = turn.costs();
    }
    Ok(())
}
