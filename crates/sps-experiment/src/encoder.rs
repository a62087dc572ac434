//! The encoder that a config asks for.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use candle_core::{Device, Tensor};
use sps_base::parallel;
use sps_dataset::Frame;
use sps_estimator::{Embedder, Network, OnnxEncoder, Precomputed};
use sps_models::encoders::{Depths, Encoder, Precision};
use sps_models::training::TrainingObjective;

use crate::config::{EncoderSpec, Network as NetworkSpec, WeightsSpec};

/// Images that are enough to scale feature maps by.
const CALIBRATION: usize = 64;

/// The network; `seed` draws the weights where they are to be untrained. One that is to compute in int8
/// computes in f32 until it is [`calibrated`].
///
/// # Errors
/// Weights that cannot be read or do not fit the network; what is wrong with an ONNX file, or with one of embeddings.
pub fn load(spec: &EncoderSpec, seed: u64) -> Result<Network> {
    let (kind, frames) = match &spec.network {
        NetworkSpec::Images(kind) => (*kind, None),
        NetworkSpec::Sequences { kind, frames } => (*kind, Some(*frames)),
        NetworkSpec::Onnx(file, settings) => {
            return Ok(Network::Onnx(OnnxEncoder::read(file, settings.clone())?));
        }
        NetworkSpec::Precomputed(file) => {
            return Ok(Network::Precomputed(Arc::new(Precomputed::read(file)?)));
        }
    };
    let encoder = match &spec.weights {
        WeightsSpec::BuiltIn => Encoder::built_in(kind)?,
        WeightsSpec::Untrained => Encoder::seeded(kind, seed)?,
        WeightsSpec::File(path) => Encoder::load(kind, path)?,
    };
    let mut encoder = encoder.with_depths(&spec.depths)?;
    if spec.precision != Precision::Int8 {
        encoder = encoder.with_precision(spec.precision)?;
    }
    Ok(match frames {
        None => Network::Images(encoder),
        Some(frames) => Network::Sequences(encoder, frames),
    })
}

/// The embedder's network in int8, its feature maps scaled by some of `count` frames, evenly spread.
///
/// # Errors
/// A frame that cannot be had, or that the network does not take.
pub fn calibrated(
    embedder: &Embedder,
    count: usize,
    frame: impl Fn(usize) -> Result<Frame> + Sync,
) -> Result<Network> {
    let some = count.min(CALIBRATION);
    let image = |i: usize| {
        let frame = frame(i * count / some)?;
        let Frame {
            width,
            height,
            data,
        } = embedder.prepared(&frame)?.into_owned();
        let frames = embedder.network().frames();
        let shape = (frames, height / frames, width, 3);
        let pixels = Tensor::from_vec(data, shape, &Device::Cpu)?;
        Ok(match embedder.network() {
            Network::Sequences(..) => pixels.permute((3, 0, 1, 2))?.unsqueeze(0)?,
            _ => pixels.permute((0, 3, 1, 2))?,
        })
    };
    let images = parallel::map(0..some, image).into_iter();
    let images: Vec<Tensor> = images.collect::<Result<_>>()?;
    let images: Vec<&Tensor> = images.iter().collect();
    let network = embedder.network();
    let encoder = network.encoder()?.clone().calibrated(&images)?;
    Ok(network.with_encoder(encoder.with_precision(Precision::Int8)?))
}

pub(crate) fn describe(spec: &EncoderSpec) -> String {
    let file_name = |path: &Path| {
        let name = path.file_name().unwrap_or(path.as_os_str());
        name.to_string_lossy().into_owned()
    };
    let (pixels, resized) = match spec.resize.map(|pixels| format!(" of {pixels} pixels")) {
        Some(pixels) => (pixels.clone(), format!(", on frames{pixels}")),
        None => (String::new(), String::new()),
    };
    let (name, frames) = match &spec.network {
        NetworkSpec::Images(kind) => (kind, resized),
        NetworkSpec::Sequences { kind, frames } => {
            (kind, format!(", on {frames} equidistant frames{pixels}"))
        }
        NetworkSpec::Onnx(file, settings) => {
            let outputs = match settings.outputs.join(" and ") {
                all if all.is_empty() => String::new(),
                some => format!(", at {some}"),
            };
            return format!("the network in {}{outputs}{resized}", file_name(file));
        }
        NetworkSpec::Precomputed(file) => return format!("embeddings from {}", file_name(file)),
    };
    let weights = match &spec.weights {
        WeightsSpec::BuiltIn => "its built-in weights".to_owned(),
        WeightsSpec::Untrained => "untrained, random weights".to_owned(),
        WeightsSpec::File(path) => format!("weights from {}", file_name(path)),
    };
    let unless_f32 = |words: &str, precision: Precision| match precision {
        Precision::F32 => String::new(),
        precision => format!(" {words} {precision}"),
    };
    let trained = spec.training.as_ref().map(|training| {
        let through = match training.objective {
            TrainingObjective::Linear {} => "",
            TrainingObjective::Heads { .. } => " through heads",
        };
        let maps = unless_f32("on maps of", training.precision);
        format!(", then trained{through} on each training part{maps}")
    });
    let trained = trained.unwrap_or_default();
    let precision = unless_f32("in", spec.precision);
    let depths = match &spec.depths {
        Depths::Last => String::new(),
        Depths::All => ", at all depths".to_owned(),
        Depths::Named(names) => format!(", at {}", names.join(" and ")),
    };
    format!("{name}{precision} with {weights}{depths}{frames}{trained}")
}
