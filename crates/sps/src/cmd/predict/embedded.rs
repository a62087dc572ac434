//! Surfaces of which a file has the embeddings.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use sps_estimator::{Estimator, Precomputed, Watch};
use sps_models::encoders::Block;

use super::print::Printer;
use super::{Args, Surface, warn_of_drift};

/// Answers each row of the file, or as many together as the model has views.
pub(super) fn answer(args: &Args, model: &Estimator, file: &Path) -> Result<()> {
    let rows = Precomputed::read(file)?;
    let expected = model.embedder().network().blocks();
    // A block that is alone may have any name.
    let alike = match (rows.blocks(), &expected[..]) {
        ([one], [other]) => one.width == other.width,
        (several, others) => several == others,
    };
    let (file, found, fitted) = (file.display(), listed(rows.blocks()), listed(&expected));
    ensure!(
        alike,
        "{file}: found the blocks {found}, expected those that the model was fitted on, {fitted}"
    );
    let (count, views) = (rows.rows(), model.about().angles.len());
    ensure!(
        count.is_multiple_of(views),
        "{file} has {count} rows, expected {views} for each surface"
    );
    let answers = model.predict_all(rows.values(), count / views, views)?;
    let mut printer = Printer::new(&args.format, args.unfamiliar, model)?;
    for (at, answer) in answers.iter().enumerate() {
        let files = rows.files().get(at * views..(at + 1) * views);
        let images = files.unwrap_or_default().iter().map(PathBuf::from);
        let mut surface = Surface::of(images.collect());
        if surface.images.is_empty() {
            surface.name = format!("surface {}", at + 1);
        }
        printer.print(&surface, answer)?;
    }
    printer.end();
    let watch = Watch::new(model).ok();
    let surfaces = rows.values().chunks_exact(views * rows.width());
    let scores = surfaces.filter_map(|row| Some(watch.as_ref()?.score(row)));
    let scores = scores.collect::<Result<_, _>>()?;
    warn_of_drift(watch, scores);
    Ok(())
}

/// `stage-1 (16), stage-2 (24)`.
fn listed(blocks: &[Block]) -> String {
    let block = |Block { name, width }: &Block| format!("{name} ({width})");
    blocks.iter().map(block).collect::<Vec<_>>().join(", ")
}
