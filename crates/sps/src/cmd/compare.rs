use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use serde::Serialize;
use sps_report::compare::{self, Comparison, Run};

use crate::output::print_json;

/// Set finished runs beside the first of them
///
/// Says which configs, sources, data and machines differ, and by how much every score of the methods
/// that both have: with paired intervals where both are scored on the same surfaces, with unpaired
/// ones elsewhere. docs/comparing.md says how to read it.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
    sps compare runs/before runs/after\n  \
    sps compare runs/main runs/branch --tolerance 0.01")]
pub struct Args {
    /// The folder of the run that the others are compared with
    first: PathBuf,
    /// Folders of other runs
    #[arg(required = true, value_name = "RUN_DIR")]
    others: Vec<PathBuf>,
    /// End with status 1 where R² of any method and property differs by more, and by more than
    /// chance, or is no longer there
    #[arg(long, value_name = "R2", value_parser = tolerance)]
    tolerance: Option<f64>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn tolerance(text: &str) -> Result<f64> {
    let found = text.parse().ok();
    let found = found.filter(|found: &f64| found.is_finite() && *found >= 0.0);
    found.context("expected a number from 0 on")
}

/// What `--json` prints.
#[derive(Serialize)]
struct Compared {
    comparisons: Vec<Comparison>,
    /// What is past the tolerance.
    past: Vec<String>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let first = Run::read(&args.first)?;
    let (mut comparisons, mut past) = (Vec::new(), Vec::new());
    for other in &args.others {
        let other = Run::read(other)?;
        let comparison = compare::compare(&first, &other)?;
        if !args.json {
            println!("{comparison}");
        }
        let found = args.tolerance.map(|tolerance| comparison.past(tolerance));
        let named = |what| format!("{}: {what}", other.path.display());
        past.extend(found.into_iter().flatten().map(named));
        comparisons.push(comparison);
    }
    let compared = Compared { comparisons, past };
    if args.json {
        print_json(&compared)?;
    }
    let past = compared.past.join("; ");
    match args.tolerance {
        Some(tolerance) if !past.is_empty() => {
            bail!("past the tolerance of {tolerance} in R²: {past}")
        }
        _ => Ok(()),
    }
}
