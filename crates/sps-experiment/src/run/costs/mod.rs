//! What one estimate costs, measured without the cache.

mod estimate;
mod turn;

use anyhow::Result;
use sps_dataset::Source;

use super::encoded::Finished;
use super::{Splits, Stage};
use crate::progress::{Progress, ensure_wanted};
use crate::results::Costs;
use turn::Turn;

/// How often each surface is estimated at most.
const ROUNDS: usize = 5;

/// Estimates properties of some held-out surfaces one by one, from the frame on: those together
/// that look at the same views. Of a method that looks at one view after the other, one property,
/// at each number of views; these are weighed by how often the method stopped there.
///
/// The methods take turns, round by round: what else the machine does comes and goes within
/// seconds, and falls on all of them alike. The time does not depend on what the weights are, so a
/// model of each method's shape is fitted to a few surfaces for it: the run's own models need not
/// be kept.
pub(crate) fn measure(
    source: &dyn Source,
    splits: &Splits,
    stage: &Stage,
    finished: &[&Finished<'_>],
) -> Result<Vec<Costs>> {
    let turns = finished.iter();
    let turns = turns.map(|finished| Turn::new(source, splits, stage, finished));
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
    Ok(turns.iter().map(Turn::costs).collect())
}
