use std::path::PathBuf;

use anyhow::Result;
use tracing::warn;

use crate::files::is_read_only;
use crate::report;
use crate::results::Results;
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
    match report::write(folder.path()).and_then(|()| folder.seal()) {
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
