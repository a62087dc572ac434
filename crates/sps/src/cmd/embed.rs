use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Value, json};
use sps_dataset::{DecodeSettings, Frame};
use sps_estimator::{Embedder, OnnxSettings, Precomputed, read_photograph};
use sps_experiment::config::{EncoderSpec, Network, WeightsSpec};
use sps_experiment::encoder;
use sps_experiment::files::write_atomically;
use sps_experiment::progress::Progress;
use sps_models::encoders::{Depths, Precision};
use tracing::info;

use crate::output::Output;

/// Embed images with an encoder
#[derive(clap::Args)]
#[command(
    after_help = "Writes the tensor `embeddings`, f32, (images, width), in the order given; of several depths \
    they lie side by side in there, and each is a tensor of its own besides. The metadata has the `files` of \
    the images, so that `fit --embeddings` and `predict --embeddings` know which row is which.\n\n\
    Example:\n  sps embed --encoder squeezenet1-0 --weights squeezenet1_0.safetensors \
    --out embeddings.safetensors photographs/*.jpg\n\n\
    With i3d, a row is a sequence of --frames images, which follow each other in the order given."
)]
pub struct Args {
    /// A name of `sps list encoders`, or an ONNX file, FILE.onnx
    #[arg(long, value_name = "NAME")]
    encoder: String,
    /// Feature maps whose means make an embedding: last, all, or names of depths with commas between them
    #[arg(long, value_name = "DEPTHS", default_value_t = Depths::All)]
    depths: Depths,
    /// Images of a sequence, for i3d
    #[arg(long, value_name = "N", default_value = "16", value_parser = clap::value_parser!(u64).range(1..))]
    frames: u64,
    /// A weights file, or `built-in`, or `untrained`
    #[arg(long, value_name = "FILE", default_value = "built-in")]
    weights: String,
    /// What to compute in: f32, bf16x2, bf16, or int8, which is scaled by up to 64 of the images
    #[arg(long, default_value_t = Precision::F32)]
    precision: Precision,
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
    #[command(flatten)]
    output: Output,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Embedded<'a> {
    embeddings: &'a Path,
    rows: usize,
    /// Numbers of a row.
    width: usize,
    /// The depths that make a row, in their order.
    blocks: Vec<Value>,
    encode_seconds_per_image: f64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let network = match args.encoder.rsplit_once('.') {
        Some((_, "onnx")) => Network::Onnx(args.encoder.clone().into(), OnnxSettings::default()),
        _ => Network::named(&args.encoder, args.frames as usize).context("--encoder")?,
    };
    let spec = EncoderSpec {
        network,
        depths: args.depths.clone(),
        weights: WeightsSpec::named(&args.weights),
        precision: args.precision,
        resize: args.resize,
        training: None,
    };
    let mut embedder = Embedder::new(encoder::load(&spec, 0)?, spec.resize)?;
    let each = embedder.network().frames();
    let count = args.images.len();
    ensure!(
        count.is_multiple_of(each),
        "{count} images, expected a multiple of --frames {each}"
    );
    if spec.precision == Precision::Int8 {
        let frame = |i: usize| {
            let paths = &args.images[i * each..(i + 1) * each];
            Ok(stacked(&read(paths, args.resize)?, each)?.remove(0))
        };
        let network = encoder::calibrated(&embedder, count / each, frame)?;
        embedder = Embedder::new(network, spec.resize)?;
    }
    let progress = Progress::new("images encoded", count);
    let mut values = Vec::new();
    let mut seconds = 0.0;
    for paths in args.images.chunks(each * args.batch as usize) {
        let frames = read(paths, args.resize)?;
        let sequences = stacked(&frames, each)?;
        let start = Instant::now();
        values.extend(embedder.embed(&sequences)?);
        seconds += start.elapsed().as_secs_f64();
        progress.advance(frames.len());
    }
    let name = |path: &PathBuf| path.to_string_lossy().into_owned();
    let files = args.images.iter().map(name).filter(|_| each == 1);
    let embeddings = Precomputed::new(embedder.network().blocks(), files.collect(), values)?;
    write_atomically(&args.out, &embeddings.to_bytes()?)?;
    let each_image = seconds / count as f64;
    info!("{count} images, {:.2} ms each to encode", 1e3 * each_image);
    let blocks = embeddings.blocks().iter();
    let blocks = blocks.map(|block| json!({ "name": block.name, "width": block.width }));
    args.output.json(&Embedded {
        embeddings: &args.out,
        rows: embeddings.rows(),
        width: embeddings.width(),
        blocks: blocks.collect(),
        encode_seconds_per_image: each_image,
    })
}

/// Photographs, the shorter side of each brought to so many pixels.
pub(super) fn read<P>(paths: &[P], resize: Option<usize>) -> Result<Vec<Frame>>
where
    P: AsRef<Path> + Sync,
{
    let settings = DecodeSettings::default();
    let read = |path: &P| Ok(read_photograph(path.as_ref(), &settings, resize)?);
    paths.par_iter().map(read).collect()
}

/// Each so many images, one below the other.
fn stacked(frames: &[Frame], each: usize) -> Result<Vec<Frame>> {
    let stack = |images: &[Frame]| {
        let (width, height) = (images[0].width, images[0].height);
        let mut sizes = images.iter().map(|image| (image.width, image.height));
        ensure!(
            sizes.all(|size| size == (width, height)),
            "images of one sequence have different sizes, expected one size"
        );
        let data = images.iter().flat_map(|image| &image.data);
        Ok(Frame {
            width,
            height: each * height,
            data: data.copied().collect(),
        })
    };
    frames.chunks_exact(each).map(stack).collect()
}
