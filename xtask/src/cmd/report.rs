use std::path::PathBuf;

use anyhow::Result;

use crate::report;
use crate::run::RunFolder;

/// Render the report of a finished run again
#[derive(clap::Args)]
#[command(after_help = "Example:\n  cargo xtask report runs/ablation")]
pub(crate) struct Args {
    /// The folder of the run
    run_dir: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let folder = RunFolder::finished(&args.run_dir)?;
    report::write(folder.path())?;
    folder.seal()?;
    println!("{}", folder.file("report.html").display());
    Ok(())
}
