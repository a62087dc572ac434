use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::docs;

/// Write the measured numbers of README.md and docs from finished runs
#[derive(clap::Args)]
#[command(
    after_help = "Runs in the root of the repository. Of each run, docs/measured keeps what tables \
    need, under the name of the run's folder; docs/measured/README.md says how a page asks for \
    it.\n\nExample:\n  \
    cargo xtask docs runs/ablation"
)]
pub(crate) struct Args {
    /// Folders of finished runs; without any, pages are written from what is kept
    #[arg(value_name = "RUN_DIR")]
    runs: Vec<PathBuf>,
    /// Write nothing; end with status 1 where a page is not what would be written
    #[arg(long, conflicts_with = "runs")]
    check: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let root = Path::new("");
    if args.check {
        return docs::check(root);
    }
    for run in &args.runs {
        for file in docs::keep(root, run)? {
            println!("{}", file.display());
        }
    }
    for page in docs::write(root)? {
        println!("{}", page.display());
    }
    Ok(())
}
