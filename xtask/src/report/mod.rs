//! `report.md`, `report.html` and `figures/*.svg`, made from `results.json` and `predictions.csv`.

mod fan;
mod figures;
mod learning;
pub(crate) mod predictions;
pub(crate) mod published;
mod selection;
mod speed;
pub(crate) mod statistics;
pub(crate) mod table;
mod tables;

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use minijinja::Environment;
use minijinja::value::Serde;
use serde::Serialize;
use sps_dataset::Unit;

use crate::files::write_atomically;
use crate::results::{MethodResult, Results};
use figures::{Figure, figures};
use table::{Table, counted};
pub(crate) use tables::tables;

/// What a report is made from.
pub(crate) const INPUTS: [&str; 2] = ["results.json", predictions::FILE];

const PAGES: [&str; 2] = ["report.md", "report.html"];

/// The folder of the figures in that of a run.
const FIGURES: &str = "figures";

const MARKDOWN: &str = include_str!("report.md.j2");
const HTML: &str = include_str!("report.html.j2");

/// What the templates print.
#[derive(Serialize)]
struct Report<'a> {
    title: &'a str,
    description: &'a str,
    data: String,
    tables: Vec<Table>,
    figures: Vec<Figure>,
    notes: Vec<String>,
}

/// Writes the report of the run in `folder`.
pub(crate) fn write(folder: &Path) -> Result<()> {
    let results = Results::read(folder)?;
    let figures = figures(&results, &predictions::read(folder)?);
    for Figure { name, svg, .. } in &figures {
        let path = folder.join(FIGURES).join(format!("{name}.svg"));
        write_atomically(&path, svg.as_bytes())?;
    }
    for path in figure_files(folder)? {
        let is_old = |figure: &Figure| path.file_stem() != Some(figure.name.as_ref());
        if figures.iter().all(is_old) {
            fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    // What is filled into a name that ends in `.html` is escaped.
    let mut environment = Environment::new();
    environment.add_template("report.md", MARKDOWN)?;
    environment.add_template("report.html", HTML)?;
    let report = Report {
        title: &results.experiment,
        description: &results.description,
        data: about_the_data(&results),
        tables: tables(&results),
        notes: notes(&results),
        figures,
    };
    for name in PAGES {
        let text = environment.get_template(name)?.render(Serde(&report))?;
        write_atomically(&folder.join(name), text.as_bytes())?;
    }
    Ok(())
}

/// The figures of a finished run, in the order of their names.
pub(crate) fn figure_files(run: &Path) -> Result<Vec<PathBuf>> {
    let folder = run.join(FIGURES);
    let failed = || format!("cannot read {}", folder.display());
    let entries = fs::read_dir(&folder).with_context(failed)?;
    let entries = entries.map(|entry| Ok(entry.with_context(failed)?.path()));
    let mut files: Vec<PathBuf> = entries.collect::<Result<_>>()?;
    files.retain(|path| path.extension().is_some_and(|ending| ending == "svg"));
    files.sort();
    Ok(files)
}

/// The names of all files of the report in the folder of a run.
pub(crate) fn files(run: &Path) -> Result<Vec<String>> {
    let figures = figure_files(run)?;
    let names = figures.iter().filter_map(|path| path.file_name());
    let figures = names.map(|name| format!("{FIGURES}/{}", name.to_string_lossy()));
    Ok(PAGES
        .map(str::to_owned)
        .into_iter()
        .chain(figures)
        .collect())
}

/// What was measured on, and how that stands to the paper's numbers.
pub(crate) fn about_the_data(results: &Results) -> String {
    let data = &results.dataset;
    let kind = if data.simulated {
        "simulated surface"
    } else {
        "surface"
    };
    let mut measured = format!(
        "Measured on {} ({}), {} each; encoder {}.",
        counted(data.surfaces, kind),
        data.name,
        counted(data.views, "view"),
        data.encoder
    );
    // Old results do not say.
    if data.training_surfaces > 0 {
        measured.push(' ');
        measured.push_str(&training_and_held_out(results));
    }
    if data.published_sps || results.methods.iter().all(|m| m.paper.is_none()) {
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
    let most = |of: fn(&MethodResult) -> usize| results.methods.iter().map(of).max().unwrap_or(0);
    let held_out = most(|method| method.held_out_surfaces);
    let mut text = format!(
        "A rerun trains on {} and is scored on others: {} different ones, all reruns together.",
        counted(data.training_surfaces, "surface"),
        held_out
    );
    if data.unit == Some(Unit::Group) {
        let groups = counted(data.units, "group");
        let _ = write!(
            text,
            " The surfaces lie in {groups}, which splits, folds and resamples keep whole."
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
