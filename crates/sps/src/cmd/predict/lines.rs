//! Photographs that are named by lines of standard input, for programs that keep the model loaded.

use std::io::{self, Write};
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;
use sps_estimator::{Answer, Estimator, Scale};

use super::Surface;
use super::print::Printer;

/// A line: the photograph of a surface, or several of one.
#[derive(Deserialize)]
#[serde(untagged)]
enum Photographs {
    One(PathBuf),
    Several(Vec<PathBuf>),
}

/// Answers each line of standard input by a line of JSON, before it reads the next.
pub(super) fn answer(model: &Estimator, scale: Scale, mut printer: Printer<'_>) -> Result<()> {
    let mut failed = 0;
    for (number, line) in (1_u64..).zip(io::stdin().lines()) {
        let line = line.context("standard input")?;
        match answered(model, scale, &line) {
            Ok((surface, answer)) => printer.print(&surface, &answer)?,
            Err(error) => {
                failed += 1;
                let refusal = serde_json::json!({ "line": number, "error": format!("{error:#}") });
                println!("{refusal}");
                io::stdout().flush()?;
            }
        }
    }
    ensure!(failed == 0, "{failed} lines have no estimate");
    Ok(())
}

fn answered(model: &Estimator, scale: Scale, line: &str) -> Result<(Surface, Answer)> {
    let images = match serde_json::from_str(line) {
        Ok(Photographs::One(path)) => vec![path],
        Ok(Photographs::Several(paths)) => paths,
        Err(_) => anyhow::bail!(
            "found `{}`, expected the path of a photograph as a JSON string, or a list of those of one \
            surface",
            line.escape_debug()
        ),
    };
    let frames = images.iter().map(|path| Ok(model.read(path, scale)?));
    let answer = model.predict(&frames.collect::<Result<Vec<_>>>()?)?;
    Ok((Surface::of(images), answer))
}
