//! `cargo xtask`: the commands of `sps`, and what only this repository needs.

mod bench;
mod cmd;
mod docs;
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
    Pretrain(cmd::pretrain::Args),
    Docs(cmd::docs::Args),
    Bench(cmd::bench::Args),
}

fn main() -> ExitCode {
    sps::main("cargo xtask", env::args_os(), |command| match command {
        Command::Sps(command) => command.run(),
        Command::Pretrain(args) => cmd::pretrain::run(args),
        Command::Docs(args) => cmd::docs::run(args),
        Command::Bench(args) => cmd::bench::run(args),
    })
}
