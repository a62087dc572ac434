//! Prints the means of a finished run as a table: `summary RUN_DIR`.

use std::path::Path;

use anyhow::Context;
use sps_experiment::results::Results;

fn main() -> anyhow::Result<()> {
    let folder = std::env::args().nth(1);
    let folder = folder.context("expected the folder of a run")?;
    let results = Results::read(Path::new(&folder))?;
    print!("{}", sps_report::summary(&results).terminal());
    Ok(())
}
