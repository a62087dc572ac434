//! The program `sps`: tactile properties of surfaces from photographs, by the commands that a user types.
//!
//! `sps --help` lists them. A program with commands of its own takes these in by `clap`'s `flatten` of
//! [`Command`], and starts by [`main`].

mod answer;
mod cmd;
pub mod fitting;
pub mod importing;
mod map;
mod output;
mod serve;

use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use tracing_indicatif::IndicatifLayer;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// The name of the program in the examples of these commands.
pub const NAME: &str = "sps";

/// Tactile properties of surfaces from photographs.
#[derive(Parser)]
#[command(version)]
struct Cli<C: Subcommand> {
    /// Threads to use [default: all cores]
    #[arg(long, value_name = "N", global = true)]
    threads: Option<usize>,
    /// Show no progress, and of the log warnings and errors alone
    #[arg(long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: C,
}

/// What a user types.
#[derive(Subcommand)]
#[expect(missing_docs, reason = "a variant's text would be that of its help")]
pub enum Command {
    Fit(Box<cmd::fit::Args>),
    Predict(cmd::predict::Args),
    Map(cmd::map::Args),
    Suggest(cmd::suggest::Args),
    Experiment(cmd::experiment::Args),
    Compare(cmd::compare::Args),
    Simulate(cmd::simulate::Args),
    Import(cmd::import::Args),
    Inspect(cmd::inspect::Args),
    Embed(cmd::embed::Args),
    Serve(cmd::serve::Args),
    Report(cmd::report::Args),
    List(cmd::list::Args),
    Completions(cmd::completions::Args),
    Man(cmd::man::Args),
}

impl Command {
    /// Does what was asked for.
    ///
    /// # Errors
    /// What went wrong, with the file, key or value that it lies in.
    pub fn run(&self) -> Result<()> {
        match self {
            Self::Fit(args) => cmd::fit::run(args),
            Self::Predict(args) => cmd::predict::run(args),
            Self::Map(args) => cmd::map::run(args),
            Self::Suggest(args) => cmd::suggest::run(args),
            Self::Experiment(args) => cmd::experiment::run(args),
            Self::Compare(args) => cmd::compare::run(args),
            Self::Simulate(args) => cmd::simulate::run(args),
            Self::Import(args) => cmd::import::run(args),
            Self::Inspect(args) => cmd::inspect::run(args),
            Self::Embed(args) => cmd::embed::run(args),
            Self::Serve(args) => cmd::serve::run(args),
            Self::Report(args) => cmd::report::run(args),
            Self::List(args) => cmd::list::run(args),
            Self::Completions(args) => cmd::completions::run(args),
            Self::Man(args) => cmd::man::run(args),
        }
    }
}

/// Runs a program of the commands `C`, which a user starts as `name`, by the command line `words`. The status
/// is 0, or 1 where the command fails; a command line that cannot be understood ends the process with 2.
pub fn main<C: Subcommand>(
    name: &'static str,
    words: impl IntoIterator<Item = OsString>,
    run: impl FnOnce(&C) -> Result<()>,
) -> ExitCode {
    end_on_closed_pipes(true);
    let matches = named(Cli::<C>::command(), name).get_matches_from(words);
    let cli = Cli::<C>::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    log(cli.quiet);
    match start_threads(cli.threads).and_then(|()| run(&cli.command)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// The command line of a program that is started as `name`, which its examples then say.
fn named(command: clap::Command, name: &'static str) -> clap::Command {
    let [from, to] = [NAME, name].map(|name| format!("\n  {name} "));
    let of = |command: clap::Command| match command.get_after_help().map(ToString::to_string) {
        Some(text) => command.after_help(text.replace(&from, &to)),
        None => command,
    };
    command.name(name).bin_name(name).mut_subcommands(of)
}

/// Makes the pool that all work is done by, where another number is asked for than it would have.
fn start_threads(count: Option<usize>) -> Result<()> {
    let Some(count) = count else { return Ok(()) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(count);
    pool.build_global().context("--threads")
}

/// Sets whether the process ends where it writes to a pipe or connection that nobody reads any more, as `head`
/// leaves one behind. Rust starts programs so that it does not, and `println!` then panics.
#[expect(unsafe_code, reason = "the standard library sets no signals")]
pub(crate) fn end_on_closed_pipes(ends: bool) {
    #[cfg(unix)]
    // SAFETY: neither action is a handler that could run at a wrong time.
    unsafe {
        let action = if ends { libc::SIG_DFL } else { libc::SIG_IGN };
        libc::signal(libc::SIGPIPE, action);
    }
}

/// Lines of the log go above the progress bars; `RUST_LOG` sets how many there are.
fn log(quiet: bool) {
    let progress = IndicatifLayer::new();
    let lines = tracing_subscriber::fmt::layer()
        .with_target(false)
        .without_time()
        .with_writer(progress.get_stderr_writer());
    let filter = EnvFilter::try_from_default_env();
    let filter = filter.unwrap_or_else(|_| EnvFilter::new(if quiet { "warn" } else { "info" }));
    tracing_subscriber::registry()
        .with(filter)
        .with(lines)
        .with(progress)
        .init();
}

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
