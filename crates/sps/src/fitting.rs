//! What `fit` writes of photographs of one's own.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use sps_base::files::write_file;
use sps_experiment::own::Chosen;
use sps_experiment::train::Trained;
use sps_report as report;

/// The page beside a model.
pub const PAGE: &str = "report.html";

/// Writes the report of the run that the method was chosen by, and the model with a copy of its page into
/// the folder `out`; a model that is there is replaced.
///
/// # Errors
/// A file that cannot be read or written.
pub fn save(chosen: &Chosen, trained: &Trained, out: &Path) -> Result<()> {
    report::write(&chosen.run)?;
    let saved = trained.model.save(out);
    saved.with_context(|| out.display().to_string())?;
    let page = chosen.run.file(PAGE);
    let page = fs::read(&page).with_context(|| page.display().to_string())?;
    let to = out.join(PAGE);
    write_file(&to, &page).with_context(|| to.display().to_string())
}
