use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::ValueEnum;
use serde::Serialize;
use sps_dataset::FrameFormat;
use sps_experiment::data::simulate;
use sps_simulate::SimulatorSpec;
use tracing::info;

use crate::output::Output;

/// Write a simulated dataset
#[derive(clap::Args)]
#[command(
    after_help = "A run that was stopped goes on where it was.\n\nExample:\n  \
    sps simulate --surfaces 400 --views 100 --size 128 --seed 1 --format png --out data/simulated"
)]
pub struct Args {
    /// Number of surfaces
    #[arg(long, value_name = "N", default_value_t = 400)]
    surfaces: usize,
    /// Number of views of each, from -45 to 45 degrees
    #[arg(long, value_name = "V", default_value_t = 100)]
    views: usize,
    /// Width and height of a view
    #[arg(long, value_name = "PX", default_value_t = 128)]
    size: usize,
    /// Seed of everything
    #[arg(long, value_name = "K", default_value_t = 1)]
    seed: u64,
    /// 8-bit display-referred PNG, or linear half-precision EXR
    #[arg(long, value_enum, default_value_t = Format::Png)]
    format: Format,
    /// The folder to write
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    output: Output,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Simulated<'a> {
    dataset: &'a Path,
    /// Surfaces written now, and those that a stopped run had left.
    written: usize,
    already_there: usize,
}

#[derive(Clone, Copy, ValueEnum)]
enum Format {
    Png,
    Exr,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let spec = SimulatorSpec {
        surfaces: args.surfaces,
        views: args.views,
        size: args.size,
        seed: args.seed,
        ..SimulatorSpec::default()
    };
    let format = match args.format {
        Format::Png => FrameFormat::Png,
        Format::Exr => FrameFormat::Exr,
    };
    let written = simulate(&spec, format, &args.out)?;
    info!(
        "{}: {} surfaces written, {} were there",
        args.out.display(),
        written.written,
        written.already_there
    );
    args.output.json(&Simulated {
        dataset: &args.out,
        written: written.written,
        already_there: written.already_there,
    })
}
