//! The regression benchmarks: wall times, ratios within one run, instruction counts and scores,
//! and what moved since a baseline. `docs/benchmarks.md` says how they are read.

mod budgets;
mod compare;
mod counts;
mod kernels;
mod machine;
mod measured;
mod scores;
mod wall;

use std::path::Path;

use anyhow::{Result, ensure};

use budgets::Budgets;
pub(crate) use kernels::run as run_kernel;
use measured::Measured;

/// What to measure, and what to do with it.
pub(crate) struct Asked<'a> {
    /// Only what has a budget.
    pub guards: bool,
    /// A finished run whose scores are checked too.
    pub results: Option<&'a Path>,
    pub save: Option<&'a str>,
    pub against: Option<&'a str>,
}

/// Measures, prints, compares; an error where a budget is exceeded.
pub(crate) fn run(asked: &Asked<'_>) -> Result<()> {
    // Before the minutes of measuring: what is asked for may not be there.
    let baseline = asked.against.map(Measured::read).transpose()?;
    let budgets = Budgets::read()?;
    let mut now = Measured::new()?;
    if let Some(folder) = asked.results {
        now.scores = scores::of_run(folder)?;
    }
    now.instructions = counts::count(&now.machine)?;
    now.wall = wall::measure(&budgets, asked.guards)?;
    now.ratios = wall::ratios(&budgets, &now)?;
    let comparison = compare::compare(&budgets, baseline.as_ref(), &now);
    print!("{comparison}");
    if let Some(name) = asked.save {
        println!("saved {}", now.write(name)?.display());
    }
    let past = comparison.past();
    ensure!(
        past.is_empty(),
        "past the budgets of {}: {}",
        budgets::FILE,
        past.join("; ")
    );
    Ok(())
}
