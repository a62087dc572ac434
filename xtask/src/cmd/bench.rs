use std::path::PathBuf;

use anyhow::Result;

use crate::bench::{self, Options};

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

pub(crate) fn run(args: &Args) -> Result<()> {
    if let Some(kernel) = &args.kernel {
        return bench::run_kernel(kernel);
    }
    bench::run(&Options {
        guards: args.guards,
        results: args.results.as_deref(),
        save: args.save.as_deref(),
        against: args.against.as_deref(),
    })
}
