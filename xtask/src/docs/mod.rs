//! Measured numbers in `README.md` and `docs`: written from finished runs, between markers.
//! `docs/measured/README.md` says how.

#[cfg(test)]
#[path = "../../../fixtures/results/mod.rs"]
mod fixture;
mod kept;
mod render;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use crate::files::matching;
use kept::Runs;
use sps_experiment::files::{read_text, write_atomically};
use sps_report::figure_files;

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
        return check(root);
    }
    let print = |file: PathBuf| println!("{}", file.display());
    for run in &args.runs {
        keep(root, run)?.into_iter().for_each(print);
    }
    write(root)?.into_iter().for_each(print);
    Ok(())
}

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
fn keep(root: &Path, run: &Path) -> Result<Vec<PathBuf>> {
    let (name, numbers) = kept::numbers(root, run)?;
    let mut kept = vec![numbers];
    let pages = paths(root)?;
    let pages = pages.iter().map(|path| read_text(path));
    let pages: Vec<String> = pages.collect::<Result<_>>()?;
    for figure in figure_files(run)? {
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
/// that changed. An error names every marker that nothing can be written for; all others are written.
fn write(root: &Path) -> Result<Vec<PathBuf>> {
    let mut pages = pages(root)?;
    pages.retain(|page| !page.edited.is_empty() || !page.unanswered.is_empty());
    for page in pages.iter().filter(|page| !page.edited.is_empty()) {
        write_atomically(&page.path, page.text.as_bytes())?;
    }
    none_of(pages.iter().flat_map(|page| page.unanswered.clone()))?;
    Ok(pages.into_iter().map(|page| page.path).collect())
}

/// Names every place below `root` that is not what `docs/measured` gives, and every marker that nothing can be written
/// for.
fn check(root: &Path) -> Result<()> {
    let pages = pages(root)?.into_iter();
    none_of(pages.flat_map(|page| [page.unanswered, page.edited].concat()))
}

fn none_of(problems: impl Iterator<Item = String>) -> Result<()> {
    let lines: Vec<String> = problems.collect();
    ensure!(lines.is_empty(), "{}", lines.join("\n"));
    Ok(())
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
    paths.extend(matching(root, "docs/**/*.md")?);
    Ok(paths)
}

/// What opens a marker, `<!-- NAME: WORDS -->`; `<!-- /NAME -->` closes it.
const OPEN: &str = "<!-- ";
const CLOSE: &str = "-->";

/// The name of a table's or paragraph's marker, and that of a number's within a sentence.
const NAMES: [&str; 2] = [render::BLOCK, render::INLINE];

impl Page {
    fn of(path: PathBuf, text: &str, runs: &Runs) -> Self {
        let (mut edited, mut unanswered) = (Vec::new(), Vec::new());
        let (mut written, mut rest) = (String::with_capacity(text.len()), text);
        while let Some((before, inside)) = rest.split_once(OPEN)
            && let Some((comment, after)) = inside.split_once(CLOSE)
        {
            let before = &text[..text.len() - rest.len() + before.len()];
            written.push_str(&rest[..rest.len() - after.len()]);
            rest = after;
            let at = |what: &str| {
                let line = 1 + before.matches('\n').count();
                format!("{}:{line}: {what}", path.display())
            };
            let comment = comment.trim();
            let (name, words) = comment.split_once(':').unwrap_or((comment, ""));
            if !NAMES.contains(&name.trim_start_matches('/')) || is_code(before) {
                continue;
            }
            if name.starts_with('/') {
                unanswered.push(at(&format!("`{name}` closes nothing")));
                continue;
            }
            let (words, closing) = (words.trim(), format!("{OPEN}/{name} {CLOSE}"));
            let found = rest.split_once(&closing);
            let Some((found, after)) = found.filter(|(found, _)| !found.contains(OPEN)) else {
                unanswered.push(at(&format!("`{words}` has no `{closing}`")));
                continue;
            };
            let wanted = render::render(runs, name, words).unwrap_or_else(|error| {
                unanswered.push(at(&format!("{error:#}")));
                found.to_owned()
            });
            if wanted != found {
                let what = "was edited, or measured again: run `cargo xtask docs`";
                edited.push(at(&format!("`{words}` {what}")));
            }
            written.extend([&wanted, closing.as_str()]);
            rest = after;
        }
        written.push_str(rest);
        Self {
            path,
            text: written,
            edited,
            unanswered,
        }
    }
}

/// Whether what follows this is code, which may show markers.
fn is_code(before: &str) -> bool {
    let is_fence = |line: &&str| line.trim_start().starts_with("```");
    before.ends_with('`') || before.lines().filter(is_fence).count() % 2 == 1
}
