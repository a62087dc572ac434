//! Reports of experiments on tactile properties, and what differs between them.
//!
//! [`write()`] makes `report.md`, `report.html`, `figures` and `tables` of a finished run from its
//! `results.json` and `predictions.csv`. [`compare`] sets runs side by side. [`tables()`] has the tables
//! themselves, for a terminal or a document.
//!
//! Nothing is printed but progress, as by `sps-experiment`.

mod calibration;
pub mod compare;
mod figures;
mod findings;
mod folders;
mod learning;
mod means;
mod page;
pub mod published;
mod scales;
mod selection;
mod speed;
pub mod statistics;
mod summary;
mod surfaces;
pub mod table;
mod tables;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde_json::json;
use sps_dataset::Unit;
use sps_experiment::files::write_atomically;
use sps_experiment::predictions::{self, Prediction};
use sps_experiment::results::{MethodResult, Results};
use sps_experiment::run::RunFolder;
use sps_experiment::text::counted;

use figures::{Figure, figures};
use page::PAGES;
pub use summary::summary;
use table::Table;
pub use tables::{gained, tables};

/// Writes the report of the run in `folder`, and the checksums of all that is then in it.
///
/// # Errors
/// Results that cannot be read; a file that cannot be written.
pub fn write(folder: &RunFolder) -> Result<()> {
    folder.seal(write_files(folder.path())?)
}

/// Writes the files of the report into the folder of the run; their names.
fn write_files(folder: &Path) -> Result<Vec<String>> {
    let results = Results::read(folder)?;
    let shown = shown(&results);
    let is_shown = |id: &str| shown.iter().any(|method| method.id == id);
    let predictions = predictions::of_methods(folder, is_shown)?;
    let estimates = shown.into_iter().map(|method| {
        let predictions = predictions.iter().filter(|one| one.method == method.id);
        Estimates {
            method,
            predictions: predictions.collect(),
        }
    });
    let estimates: Vec<Estimates<'_>> = estimates.collect();
    let figures = figures(&results, &estimates);
    let tables = tables(&results);
    let best = estimates.first();
    let gallery = best.and_then(|best| surfaces::gallery(folder, &results, best));
    let mut written = PAGES.map(str::to_owned).to_vec();
    written.extend(folders::FIGURES.write(folder, &drawn(&figures))?);
    written.extend(folders::TABLES.write(folder, &printed(&tables)?)?);
    let page = json!({
        "title": results.experiment,
        "description": results.description,
        "findings": findings::of(&results),
        "data": about_the_data(&results),
        "sections": page::sections(&tables, &figures, gallery.as_ref()),
        "notes": notes(&results),
    });
    for (name, text) in PAGES.iter().zip(page::texts(page)?) {
        write_atomically(&folder.join(name), text.as_bytes())?;
    }
    Ok(written)
}

/// The held-out estimates of a method.
struct Estimates<'a> {
    method: &'a MethodResult,
    predictions: Vec<&'a Prediction>,
}

const WITH_INTERVALS: usize = 5;

/// The methods whose single estimates are shown: the best, then those with intervals.
fn shown(results: &Results) -> Vec<&MethodResult> {
    let best = results.best();
    let others = results.methods.iter().filter(|method| {
        let has_intervals = method.adaptive.is_some() || method.intervals.is_some();
        has_intervals && best.is_none_or(|best| best.id != method.id)
    });
    let others = others.take(WITH_INTERVALS);
    best.into_iter().chain(others).collect()
}

fn drawn(figures: &[Figure]) -> BTreeMap<String, Vec<u8>> {
    let file = |figure: &Figure| (format!("{}.svg", figure.name), figure.svg.clone().into());
    figures.iter().map(file).collect()
}

/// The files of tables, by their names: for programs as CSV, for papers as LaTeX.
fn printed(tables: &[Table]) -> Result<BTreeMap<String, Vec<u8>>> {
    let mut files = BTreeMap::new();
    for table in tables {
        files.insert(format!("{}.csv", table.name), table.csv()?);
        files.insert(format!("{}.tex", table.name), table.latex().into());
    }
    Ok(files)
}

/// The figures of a finished run, in the order of their names.
///
/// # Errors
/// A folder that cannot be read.
pub fn figure_files(run: &Path) -> Result<Vec<PathBuf>> {
    folders::FIGURES.paths(run)
}

/// What was measured on, and how that stands to the paper's numbers.
pub fn about_the_data(results: &Results) -> String {
    let data = &results.dataset;
    let kind = if data.simulated {
        "simulated surface"
    } else {
        "surface"
    };
    let measured = format!(
        "Measured on {} ({}), {} each; encoder {}. {}",
        counted(data.surfaces, kind),
        data.name,
        counted(data.views, "view"),
        data.encoder,
        training_and_held_out(results)
    );
    if !data.simulated || results.methods.iter().all(|m| m.paper.is_none()) {
        return measured;
    }
    format!(
        "{measured} The paper's printed values were measured on its own photographs and Toccare \
         readings: they come from different data, so compare which method is ahead of which, not \
         the numbers."
    )
}

fn training_and_held_out(results: &Results) -> String {
    let data = &results.dataset;
    let held_out = results.methods.iter().map(|m| m.held_out_surfaces);
    let mut text = format!(
        "A rerun trains on {} and is scored on others: {} different ones, all reruns together.",
        counted(data.training_surfaces, "surface"),
        held_out.max().unwrap_or(0)
    );
    if let Some(unit @ (Unit::Group | Unit::Material)) = data.unit {
        let units = counted(data.units, unit.name());
        let _ = write!(
            text,
            " The surfaces lie in {units}, which splits and folds keep whole."
        );
    }
    text
}

fn notes(results: &Results) -> Vec<String> {
    let of_methods = results.methods.iter().flat_map(|method| {
        let note = move |note: &String| format!("{}: {note}", method.label);
        method.notes.iter().map(note)
    });
    results.notes.iter().cloned().chain(of_methods).collect()
}

#[cfg(test)]
#[path = "../../../fixtures/results/mod.rs"]
mod fixture;

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
