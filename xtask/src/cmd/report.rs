use std::path::PathBuf;

use anyhow::{Result, ensure};

use crate::{checksums, report, run};

/// Render the report of a finished run again
#[derive(clap::Args)]
#[command(after_help = "Example:\n  cargo xtask report runs/ablation")]
pub(crate) struct Args {
    /// The folder of the run
    run_dir: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let damaged = checksums::damaged(&args.run_dir)?;
    for input in report::INPUTS {
        ensure!(
            !damaged.iter().any(|name| name == input),
            "{}: the checksum does not match its content; `cargo xtask experiment` writes it again",
            args.run_dir.join(input).display()
        );
    }
    report::write(&args.run_dir)?;
    run::seal(&args.run_dir)?;
    println!("{}", args.run_dir.join("report.html").display());
    Ok(())
}
