//! The regression benchmarks: wall times, ratios within one run, instruction counts and scores,
//! and what moved since a baseline. `docs/benchmarks.md` says how they are read.

mod budgets;
mod compare;
mod counts;
mod kernels;
mod machine;
mod measured;
mod wall;

use std::path::PathBuf;

use anyhow::{Result, ensure};
use tracing::warn;

use budgets::Budgets;
use machine::Machine;
use measured::Measured;

/// Measure every stage, and what moved since a baseline
///
/// Prints wall times, ratios of wall times, and instruction counts of the kernels (where valgrind is
/// installed). Ends with status 1 where one is past its budget in benches/budgets.toml.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
    cargo xtask bench --save before\n  \
    cargo xtask bench --against before\n  \
    cargo xtask bench --guards --results runs/smoke --against main")]
pub(crate) struct Args {
    /// Write what was measured to benches/baselines/NAME.json
    #[arg(long, value_name = "NAME")]
    save: Option<String>,
    /// Compare with benches/baselines/NAME.json
    #[arg(long, value_name = "NAME")]
    against: Option<String>,
    /// Measure only what has a budget
    #[arg(long)]
    guards: bool,
    /// Take in the scores of a finished run
    #[arg(long, value_name = "RUN_DIR")]
    results: Option<PathBuf>,
    /// Run one of the kernels whose instructions are counted
    #[arg(long, value_name = "KERNEL", hide = true)]
    kernel: Option<String>,
}

/// How often the ratios past their budgets are measured before that is believed: the shortest time
/// of all attempts counts, and what else the machine does is not the same each time.
const ATTEMPTS: usize = 3;

/// Says what may stay unguarded under `CI=true`: `instructions`, `ratios`, or both with a comma.
const UNGUARDED: &str = "SPS_UNGUARDED";

/// Measures, prints, compares; an error where a budget is exceeded, and under `CI=true` where a guard
/// is silent that [`UNGUARDED`] does not name.
pub(crate) fn run(args: &Args) -> Result<()> {
    if let Some(kernel) = &args.kernel {
        return kernels::run(kernel);
    }
    // Before the minutes of measuring: what is asked for may not be there.
    let baseline = args.against.as_deref().map(Measured::read).transpose()?;
    let budgets = Budgets::read()?;
    let mut now = Measured {
        machine: Machine::here()?,
        ..Measured::default()
    };
    if let Some(then) = baseline.as_ref().filter(|_| args.guards) {
        let ci = std::env::var("CI").is_ok_and(|ci| ci == "true");
        let accepted = std::env::var(UNGUARDED).unwrap_or_default();
        let all = "instructions,ratios";
        let accepted = if ci { &accepted } else { all };
        check_guarded(&then.machine, &now.machine, accepted)?;
    }
    if let Some(folder) = &args.results {
        now.scores = measured::scores(folder)?;
    }
    now.instructions = counts::count(&now.machine)?;
    now.wall = if args.guards {
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
    if let Some(name) = &args.save {
        println!("saved {}", now.write(name)?.display());
    }
    let (file, past) = (budgets::FILE, comparison.past().join("; "));
    ensure!(past.is_empty(), "past the budgets of {file}: {past}");
    Ok(())
}

/// Names what `now` cannot be compared with `then` in; an error unless it is `accepted`.
fn check_guarded(then: &Machine, now: &Machine, accepted: &str) -> Result<()> {
    let reasons = [
        ("instructions", then.other_instructions(now)),
        ("ratios", then.other_ratios(now)),
    ];
    for (what, reason) in reasons {
        let Some(reason) = reason else { continue };
        ensure!(
            accepted.split(',').any(|name| name == what),
            "{what} are not guarded: {reason}; `{UNGUARDED}={what}` accepts that"
        );
        warn!("{what} are not guarded: {reason}");
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_guard_is_silent_only_where_that_is_accepted() {
        let refused = |change: fn(&mut Machine), accepted| {
            let then = Machine {
                rustc: "rustc 1".to_owned(),
                valgrind: Some("valgrind 3".to_owned()),
                ..Machine::default()
            };
            let mut now = then.clone();
            change(&mut now);
            let error = check_guarded(&then, &now, accepted).err();
            error.map(|error| error.to_string()).unwrap_or_default()
        };
        assert_eq!(refused(|_| (), ""), "");
        let bare = |now: &mut Machine| now.valgrind = None;
        assert_eq!(
            refused(bare, "ratios"),
            "instructions are not guarded: the baseline is of rustc 1 under valgrind 3, here is rustc 1 under no \
             valgrind; `SPS_UNGUARDED=instructions` accepts that"
        );
        assert_eq!(refused(bare, "ratios,instructions"), "");
        assert_ne!(refused(|now| now.rustc = "rustc 2".to_owned(), ""), "");
        let larger = |now: &mut Machine| now.cores = 64;
        assert!(refused(larger, "instructions").starts_with("ratios"));
        assert_eq!(refused(larger, "ratios"), "");
    }
}
