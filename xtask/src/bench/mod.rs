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
pub(crate) use machine::processor;
use measured::Measured;

/// What to measure, and what to do with it.
pub(crate) struct Options<'a> {
    /// Only what has a budget.
    pub guards: bool,
    /// A finished run whose scores are checked too.
    pub results: Option<&'a Path>,
    pub save: Option<&'a str>,
    pub against: Option<&'a str>,
}

/// How often the ratios past their budgets are measured before that is believed: the shortest time
/// of all attempts counts, and what else the machine does is not the same each time.
const ATTEMPTS: usize = 3;

/// Measures, prints, compares; an error where a budget is exceeded.
pub(crate) fn run(options: &Options<'_>) -> Result<()> {
    // Before the minutes of measuring: what is asked for may not be there.
    let baseline = options.against.map(Measured::read).transpose()?;
    let budgets = Budgets::read()?;
    let mut now = Measured::new()?;
    if let Some(folder) = options.results {
        now.scores = scores::of_run(folder)?;
    }
    now.instructions = counts::count(&now.machine)?;
    now.wall = if options.guards {
        wall::of_ratios(&budgets.ratios.iter().collect::<Vec<_>>())?
    } else {
        wall::all()?
    };
    now.ratios = wall::ratios(&budgets, &now.wall)?;
    for _ in 1..ATTEMPTS {
        measure_again(&budgets, baseline.as_ref(), &mut now)?;
    }
    let comparison = compare::compare(&budgets, baseline.as_ref(), &now);
    print!("{comparison}");
    if let Some(name) = options.save {
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

/// Measures again what ratios past their budgets are made of.
fn measure_again(budgets: &Budgets, then: Option<&Measured>, now: &mut Measured) -> Result<()> {
    let past = compare::ratios_past(budgets, then, now);
    for (name, wall) in wall::of_ratios(&past)? {
        if let Some(before) = now.wall.get_mut(&name) {
            before.shortest = before.shortest.min(wall.shortest);
        }
    }
    now.ratios = wall::ratios(budgets, &now.wall)?;
    Ok(())
}
