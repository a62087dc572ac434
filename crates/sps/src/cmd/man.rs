use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::CommandFactory;
use sps_experiment::files::create_folder;

use crate::{Cli, Command, NAME};

/// Write a manual page of `sps` and of each command
#[derive(clap::Args)]
#[command(after_help = "Example:\n  sps man ~/.local/share/man/man1")]
pub struct Args {
    /// The folder to write to
    #[arg(value_name = "DIR")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    create_folder(&args.out)?;
    let command = Cli::<Command>::command().name(NAME);
    clap_mangen::generate_to(command, &args.out).with_context(|| args.out.display().to_string())
}
