use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use rayon::prelude::*;
use safetensors::tensor::{Dtype, TensorView};
use sps_dataset::{DecodeSettings, Frame, read_image};
use sps_models::encoders::{EncoderKind, Precision};
use tracing::info;

use crate::config::{EncoderSpec, WeightsSpec};
use crate::embeddings::Embedder;
use crate::encoder;
use crate::files::write_atomically;
use crate::progress::Progress;

/// Embed images with an encoder
#[derive(clap::Args)]
#[command(
    after_help = "Writes the tensor `embeddings`, f32, (images, width), in the order given.\n\n\
    Example:\n  cargo xtask embed --encoder squeezenet1-0 --weights squeezenet1_0.safetensors \
    --out embeddings.safetensors photographs/*.jpg"
)]
pub(crate) struct Args {
    /// se-resnext50-32x4d, se-resnext-small or squeezenet1-0
    #[arg(long, value_name = "NAME")]
    encoder: EncoderKind,
    /// A weights file, or `built-in`, or `untrained`
    #[arg(long, value_name = "FILE")]
    weights: String,
    /// What to compute in: f32, or bf16, which is faster on processors with AVX512-BF16
    #[arg(long, default_value_t = Precision::F32)]
    precision: Precision,
    /// Threads to use [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Images encoded at once
    #[arg(long, value_name = "N", default_value = "8", value_parser = clap::value_parser!(u64).range(1..))]
    batch: u64,
    /// Bring the shorter side to so many pixels; by default images keep their size
    #[arg(long, value_name = "PIXELS")]
    resize: Option<usize>,
    /// The file to write
    #[arg(long, value_name = "FILE.safetensors")]
    out: PathBuf,
    /// PNG, JPEG or EXR
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    if let Some(threads) = args.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .context("--threads")?;
    }
    let spec = EncoderSpec {
        kind: args.encoder,
        weights: WeightsSpec::named(&args.weights),
        precision: args.precision,
        resize: args.resize,
        training: None,
    };
    let embedder = Embedder::new(encoder::load(&spec, 0)?, spec.resize)?;
    let progress = Progress::new("images encoded", args.images.len());
    let mut values = Vec::new();
    let mut seconds = 0.0;
    for paths in args.images.chunks(args.batch as usize) {
        let frames = read(paths)?;
        let start = Instant::now();
        values.extend(embedder.embed(&frames)?);
        seconds += start.elapsed().as_secs_f64();
        progress.advance(frames.len());
    }
    write(&args.out, &values, args.images.len())?;
    info!(
        "{} images, {:.1} ms each to encode",
        args.images.len(),
        1e3 * seconds / args.images.len() as f64
    );
    Ok(())
}

fn read(paths: &[PathBuf]) -> Result<Vec<Frame>> {
    let settings = DecodeSettings::default();
    let decoded = paths.par_iter().map(|path| read_image(path, &settings));
    let frames = decoded.map(|decoded| Ok(decoded?.frame));
    frames.collect()
}

fn write(path: &Path, values: &[f32], rows: usize) -> Result<()> {
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let shape = vec![rows, values.len() / rows];
    let view = TensorView::new(Dtype::F32, shape, &bytes)?;
    write_atomically(path, &safetensors::serialize([("embeddings", view)], None)?)
}
