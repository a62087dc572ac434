use std::io;

use anyhow::Result;
use clap::CommandFactory;
use clap_complete::Shell;

use crate::{Cli, Command, NAME};

/// Print what a shell needs to complete the commands of `sps`
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  sps completions bash > ~/.local/share/bash-completion/completions/sps"
)]
pub struct Args {
    #[arg(value_enum)]
    shell: Shell,
}

#[expect(clippy::unnecessary_wraps, reason = "as every command")]
pub(crate) fn run(args: &Args) -> Result<()> {
    let mut command = Cli::<Command>::command();
    clap_complete::generate(args.shell, &mut command, NAME, &mut io::stdout());
    Ok(())
}
