use std::path::PathBuf;

use anyhow::Result;

/// Render the report of a finished run again
#[derive(clap::Args)]
#[command(after_help = "Example:\n  cargo xtask report runs/ablation")]
pub(crate) struct Args {
    /// The folder of the run
    run_dir: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    crate::report::write(&args.run_dir)?;
    println!("{}", args.run_dir.join("report.html").display());
    Ok(())
}
