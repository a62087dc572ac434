use std::path::{Path, PathBuf};

use anyhow::Result;
use sps_estimator::{Embedder, Network};
use sps_experiment::progress::Progress;
use sps_models::encoders::{Depths, Encoder, EncoderKind};
use sps_regress::kernel_ridge::{KernelRidge, KernelRidgeConfig};
use tracing::warn;

use super::embed::read;
use crate::importing::{Import, Options, Request, photographs_below};
use crate::output::print_json;

/// Say which surfaces to measure next, by photographs of them
#[derive(clap::Args)]
#[command(
    after_help = "The most telling come first: once they are measured, kernel ridge regression is least uncertain \
    about all the others.\n\nPhotographs that have a row in the table are measured already; every other one is a \
    surface of its own.\n\nExample:\n  \
    sps suggest fixtures/tiny-dataset/frames --count 3"
)]
pub struct Args {
    /// The folder of the photographs: PNG, JPEG or EXR
    photographs: PathBuf,
    /// The table of what is measured so far, as `fit` reads it
    #[arg(long, value_name = "FILE.csv")]
    values: Option<PathBuf>,
    #[command(flatten)]
    options: Options,
    /// How many to name
    #[arg(long, value_name = "N", default_value = "20")]
    count: usize,
    /// Bring the shorter side of every photograph to so many pixels
    #[arg(long, value_name = "PIXELS", default_value = "256", value_parser = clap::value_parser!(u64).range(32..))]
    pixels: u64,
    /// Print a list in JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let (measured, open) = photographs(args)?;
    let all: Vec<&Path> = measured.iter().chain(&open).map(PathBuf::as_path).collect();
    let encoder = Encoder::built_in(EncoderKind::EfficientNetLiteBody)?;
    let network = Network::Images(encoder.with_depths(&Depths::All)?);
    let embedder = Embedder::new(network, Some(args.pixels as usize))?;
    let values = embedded(&embedder, &all)?;
    let embeddings = embedder.table(&values, all.len(), 1)?;
    let known: Vec<usize> = (0..measured.len()).collect();
    let ridge = KernelRidge::new(KernelRidgeConfig::default())?;
    let next = ridge.most_telling(&embeddings, &known, args.count)?;
    if open.is_empty() {
        warn!("nothing is left to measure: every photograph has values");
    }
    let next: Vec<&Path> = next.into_iter().map(|at| all[at]).collect();
    if args.json {
        print_json(&next)?;
    } else {
        for path in &next {
            println!("{}", path.display());
        }
    }
    Ok(())
}

/// The photographs of surfaces that are measured, and the others.
fn photographs(args: &Args) -> Result<(Vec<PathBuf>, Vec<PathBuf>)> {
    let folder = &args.photographs;
    let Some(values) = &args.values else {
        return Ok((Vec::new(), photographs_below(folder)?));
    };
    let import = Import::find(&Request {
        photographs: folder,
        values,
        options: &args.options,
    })?;
    let open = import.without_row().iter().map(|path| folder.join(path));
    let measured = import.photographs().map(Path::to_owned);
    Ok((measured.collect(), open.collect()))
}

/// The embeddings of photographs, `(photographs, width)`.
fn embedded(embedder: &Embedder, photographs: &[&Path]) -> Result<Vec<f32>> {
    const AT_ONCE: usize = 16;
    let progress = Progress::new("photographs encoded", photographs.len());
    let mut values = Vec::new();
    for paths in photographs.chunks(AT_ONCE) {
        values.extend(embedder.embed(&read(paths, embedder.resize())?)?);
        progress.advance(paths.len());
    }
    Ok(values)
}
