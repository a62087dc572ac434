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
use tracing::warn;

use budgets::Budgets;
pub(crate) use kernels::run as run_kernel;
use machine::Machine;
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

/// Says what may stay unguarded under `CI=true`: `instructions`, `ratios`, or both with a comma.
const UNGUARDED: &str = "SPS_UNGUARDED";

/// Measures, prints, compares; an error where a budget is exceeded, and under `CI=true` where a guard
/// is silent that [`UNGUARDED`] does not name.
pub(crate) fn run(options: &Options<'_>) -> Result<()> {
    // Before the minutes of measuring: what is asked for may not be there.
    let baseline = options.against.map(Measured::read).transpose()?;
    let budgets = Budgets::read()?;
    let mut now = Measured::new()?;
    if let Some(then) = baseline.as_ref().filter(|_| options.guards) {
        let ci = std::env::var("CI").is_ok_and(|ci| ci == "true");
        let accepted = std::env::var(UNGUARDED).unwrap_or_default();
        let all = "instructions,ratios";
        let accepted = if ci { &accepted } else { all };
        check_guarded(&then.machine, &now.machine, accepted)?;
    }
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
        let then = Machine {
            processor: "one".to_owned(),
            cores: 2,
            vectors: "AVX2".to_owned(),
            rustc: "rustc 1".to_owned(),
            valgrind: Some("valgrind 3".to_owned()),
        };
        let refused = |now: &Machine, accepted| {
            let error = check_guarded(&then, now, accepted).err();
            error.map(|error| error.to_string())
        };
        assert_eq!(refused(&then, ""), None);
        let bare = Machine {
            valgrind: None,
            ..then.clone()
        };
        assert_eq!(
            refused(&bare, "ratios").unwrap(),
            "instructions are not guarded: the baseline is of rustc 1 under valgrind 3, here is rustc 1 under no \
             valgrind; `SPS_UNGUARDED=instructions` accepts that"
        );
        assert_eq!(refused(&bare, "ratios,instructions"), None);
        let newer = Machine {
            rustc: "rustc 2".to_owned(),
            ..then.clone()
        };
        assert!(refused(&newer, "").is_some());
        let larger = Machine {
            cores: 64,
            ..then.clone()
        };
        assert!(
            refused(&larger, "instructions")
                .unwrap()
                .starts_with("ratios")
        );
        assert_eq!(refused(&larger, "ratios"), None);
    }
}
