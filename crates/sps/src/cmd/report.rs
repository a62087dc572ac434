use std::path::PathBuf;

use anyhow::Result;
use sps_experiment::files::is_read_only;
use sps_experiment::results::Results;
use sps_experiment::run::RunFolder;
use sps_report as report;
use tracing::warn;

/// Render the report of a finished run again
#[derive(clap::Args)]
#[command(after_help = "Example:\n  sps report runs/ablation")]
pub struct Args {
    /// The folder of the run
    run_dir: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let folder = RunFolder::finished(&args.run_dir)?;
    match report::write(&folder) {
        Err(error) if is_read_only(&error) => {
            warn!("the report was not written: {error:#}");
            let results = Results::read(folder.path())?;
            print!("{}", report::summary(&results).terminal());
        }
        written => {
            written?;
            println!("{}", folder.file("report.html").display());
        }
    }
    Ok(())
}
