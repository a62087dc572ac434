//! Measured numbers in `README.md` and `docs`: written from finished runs, between markers.
//! `docs/measured/README.md` says how.

mod kept;
mod markers;
mod render;
#[cfg(test)]
mod tests;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use crate::files::{read_text, write_atomically};
use crate::report;
use kept::Runs;
use markers::{Marker, markers};

/// A page as it should be.
struct Page {
    path: PathBuf,
    text: String,
    /// Places that differ, with their lines.
    edited: Vec<String>,
    /// Markers that nothing can be written for, with their lines.
    unanswered: Vec<String>,
}

/// Keeps what the documents need of a finished run below `root`: its numbers, and the figures that a
/// page shows as `images/RUN-FIGURE.svg`. Returns the files.
///
/// # Errors
/// A run that is not finished, or damaged; a file that cannot be written.
pub(crate) fn keep(root: &Path, run: &Path) -> Result<Vec<PathBuf>> {
    let (name, numbers) = kept::numbers(root, run)?;
    let mut kept = vec![numbers];
    let pages = paths(root)?;
    let pages: Vec<String> = pages
        .iter()
        .map(|path| read_text(path))
        .collect::<Result<_>>()?;
    for figure in report::figure_files(run)? {
        let file = figure.file_name().unwrap_or_default().to_string_lossy();
        let image = format!("images/{name}-{file}");
        if pages.iter().any(|page| page.contains(&image)) {
            let path = root.join("docs").join(image);
            write_atomically(&path, read_text(&figure)?.as_bytes())?;
            kept.push(path);
        }
    }
    Ok(kept)
}

/// Writes every marked place below `root` anew, from what `docs/measured` keeps; returns the pages
/// that changed.
///
/// # Errors
/// Names every marker that nothing can be written for; all others are written.
pub(crate) fn write(root: &Path) -> Result<Vec<PathBuf>> {
    let mut pages = pages(root)?;
    pages.retain(|page| !page.edited.is_empty() || !page.unanswered.is_empty());
    for page in pages.iter().filter(|page| !page.edited.is_empty()) {
        write_atomically(&page.path, page.text.as_bytes())?;
    }
    none_of(pages.iter().flat_map(|page| &page.unanswered))?;
    Ok(pages.into_iter().map(|page| page.path).collect())
}

/// Whether every marked place below `root` is what `docs/measured` gives.
///
/// # Errors
/// Names every place that differs, and every marker that nothing can be written for.
pub(crate) fn check(root: &Path) -> Result<()> {
    let pages = pages(root)?;
    let problems = pages
        .iter()
        .flat_map(|page| page.unanswered.iter().chain(&page.edited));
    none_of(problems)
}

fn none_of<'a>(problems: impl Iterator<Item = &'a String>) -> Result<()> {
    let lines: Vec<&str> = problems.map(String::as_str).collect();
    if lines.is_empty() {
        return Ok(());
    }
    bail!("{}", lines.join("\n"))
}

/// `README.md` and the pages below `docs`, each as it should be.
fn pages(root: &Path) -> Result<Vec<Page>> {
    let runs = Runs::read(root)?;
    let page = |path: PathBuf| {
        let text = read_text(&path)?;
        Ok(Page::of(path, &text, &runs))
    };
    paths(root)?.into_iter().map(page).collect()
}

/// `README.md` and the Markdown files below `docs`.
fn paths(root: &Path) -> Result<Vec<PathBuf>> {
    let mut paths = vec![root.join("README.md")];
    below(&root.join("docs"), &mut paths)?;
    Ok(paths)
}

fn below(folder: &Path, pages: &mut Vec<PathBuf>) -> Result<()> {
    let failed = || format!("cannot read {}", folder.display());
    let entries = fs::read_dir(folder).with_context(failed)?;
    let entries = entries.map(|entry| Ok(entry.with_context(failed)?.path()));
    let mut entries: Vec<PathBuf> = entries.collect::<Result<_>>()?;
    entries.sort();
    for path in entries {
        if path.is_dir() {
            below(&path, pages)?;
        } else if path.extension().is_some_and(|ending| ending == "md") {
            pages.push(path);
        }
    }
    Ok(())
}

impl Page {
    fn of(path: PathBuf, text: &str, runs: &Runs) -> Self {
        let (mut edited, mut unanswered) = (Vec::new(), Vec::new());
        let at = |line: usize, what: &str| format!("{}:{line}: {what}", path.display());
        let (markers, unclosed) = markers(text);
        unanswered.extend(unclosed.iter().map(|(line, what)| at(*line, what)));
        let (mut written, mut end) = (String::with_capacity(text.len()), 0);
        for Marker {
            line,
            form,
            words,
            inner,
        } in markers
        {
            let found = &text[inner.clone()];
            let wanted = render::render(runs, form, &words).unwrap_or_else(|error| {
                unanswered.push(at(line, &format!("{error:#}")));
                found.to_owned()
            });
            if wanted != found {
                let what =
                    format!("`{words}` was edited, or measured again: run `cargo xtask docs`");
                edited.push(at(line, &what));
            }
            written.push_str(&text[end..inner.start]);
            written.push_str(&wanted);
            end = inner.end;
        }
        written.push_str(&text[end..]);
        Self {
            path,
            text: written,
            edited,
            unanswered,
        }
    }
}
