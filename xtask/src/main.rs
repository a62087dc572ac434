//! `cargo xtask`: runs experiments, and everything else that needs more than one crate.

mod bench;
mod cells;
mod checksums;
mod cmd;
mod compare;
mod config;
mod data;
mod digits;
mod docs;
mod embeddings;
mod encoder;
mod files;
#[cfg(test)]
#[path = "../../fixtures/fuzz/mod.rs"]
mod fuzz;
mod importing;
mod journal;
mod map;
mod memory;
mod paper;
mod pretraining;
mod progress;
mod report;
mod results;
mod run;
mod sequences;
mod training;
mod work;

use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Parser, Subcommand};
use tracing_indicatif::IndicatifLayer;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Tactile properties of surfaces from photographs.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Cli {
    /// Threads to use [default: all cores]
    #[arg(long, value_name = "N", global = true)]
    threads: Option<usize>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Experiment(cmd::experiment::Args),
    Compare(cmd::compare::Args),
    Simulate(cmd::simulate::Args),
    Import(cmd::import::Args),
    Inspect(cmd::inspect::Args),
    Embed(cmd::embed::Args),
    Pretrain(cmd::pretrain::Args),
    Train(cmd::train::Args),
    Predict(cmd::predict::Args),
    Report(cmd::report::Args),
    Docs(cmd::docs::Args),
    Bench(cmd::bench::Args),
}

fn main() -> ExitCode {
    end_quietly_on_closed_pipes();
    let cli = Cli::parse();
    log();
    let outcome = start_threads(cli.threads).and_then(|()| dispatch(cli.command));
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Makes the pool that all work is done by, where another number is asked for than it would have.
fn start_threads(count: Option<usize>) -> Result<()> {
    let Some(count) = count else { return Ok(()) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(count);
    pool.build_global().context("--threads")
}

fn dispatch(command: Command) -> Result<()> {
    match command {
        Command::Experiment(args) => cmd::experiment::run(&args),
        Command::Compare(args) => cmd::compare::run(&args),
        Command::Simulate(args) => cmd::simulate::run(&args),
        Command::Import(args) => cmd::import::run(&args),
        Command::Inspect(args) => cmd::inspect::run(&args),
        Command::Embed(args) => cmd::embed::run(&args),
        Command::Pretrain(args) => cmd::pretrain::run(&args),
        Command::Train(args) => cmd::train::run(&args),
        Command::Predict(args) => cmd::predict::run(&args),
        Command::Report(args) => cmd::report::run(&args),
        Command::Docs(args) => cmd::docs::run(&args),
        Command::Bench(args) => cmd::bench::run(&args),
    }
}

/// Ends the process where it writes to a pipe that nobody reads any more, as `head` leaves one behind.
/// Rust starts programs with that signal ignored, and `println!` then panics.
#[expect(
    unsafe_code,
    reason = "the standard library has no way to reset a signal"
)]
fn end_quietly_on_closed_pipes() {
    #[cfg(unix)]
    // SAFETY: the default action is no handler that could run at a wrong time, and no other thread runs
    // yet.
    unsafe {
        libc::signal(libc::SIGPIPE, libc::SIG_DFL);
    }
}

/// Lines of the log go above the progress bars; `RUST_LOG` sets how many there are.
fn log() {
    let progress = IndicatifLayer::new();
    let lines = tracing_subscriber::fmt::layer()
        .with_target(false)
        .without_time()
        .with_writer(progress.get_stderr_writer());
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    tracing_subscriber::registry()
        .with(filter)
        .with(lines)
        .with(progress)
        .init();
}
