//! `cargo xtask`: the commands of `sps`, and what only this repository needs.

mod bench;
mod docs;
mod files;
mod pretraining;

use std::env;
use std::process::ExitCode;

use clap::Subcommand;
use sps_base::memory::CountingAllocator;

/// Counts what an estimate allocates, which results say.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[derive(Subcommand)]
enum Command {
    #[command(flatten)]
    Sps(sps::Command),
    Pretrain(pretraining::Args),
    Docs(docs::Args),
    Bench(bench::Args),
}

fn main() -> ExitCode {
    sps::main("cargo xtask", env::args_os(), |command| match command {
        Command::Sps(command) => command.run(),
        Command::Pretrain(args) => pretraining::run(args),
        Command::Docs(args) => docs::run(args),
        Command::Bench(args) => bench::run(args),
    })
}
