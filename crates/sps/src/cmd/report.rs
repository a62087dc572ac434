use std::path::PathBuf;

use anyhow::Result;
use sps_experiment::files::is_read_only;
use sps_experiment::results::Results;
use sps_experiment::run::RunFolder;
use sps_report as report;
use tracing::warn;

use crate::output::Output;

/// Render the report of a finished run again
#[derive(clap::Args)]
#[command(
    after_help = "JSON is the content of results.json.\n\nExample:\n  sps report runs/ablation"
)]
pub struct Args {
    /// The folder of the run
    run_dir: PathBuf,
    #[command(flatten)]
    output: Output,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let folder = RunFolder::finished(&args.run_dir)?;
    let results = Results::read(folder.path())?;
    match report::write(&folder) {
        Err(error) if is_read_only(&error) => {
            warn!("the report was not written: {error:#}");
            let summary = report::summary(&results).terminal();
            args.output.say(summary.trim_end());
        }
        written => {
            written?;
            let page = folder.file("report.html");
            args.output.say(&page.display().to_string());
        }
    }
    args.output.json(&results)
}
