//! The encoder that a config asks for.

use anyhow::{Result, bail, ensure};
use candle_core::{Device, Tensor};
use rayon::prelude::*;
use sps_dataset::Frame;
use sps_estimator::Network;
use sps_models::encoders::{Encoder, EncoderKind, I3d, Precision};
use sps_models::training::TrainingObjective;
use sps_models::weights::Weights;

use crate::config::{EncoderSpec, Network as NetworkSpec, WeightsSpec};

/// Trained by `pretrain configs/pretrain.toml`.
const EFFICIENTNET_LITE_SMALL: &[u8] =
    include_bytes!("../../fixtures/encoders/efficientnet-lite-small.safetensors");

/// Trained on simulated surfaces alone.
const SE_RESNEXT_SMALL: &[u8] =
    include_bytes!("../../fixtures/encoders/se-resnext-small.safetensors");

/// Images that are enough to scale feature maps by.
const CALIBRATION: usize = 64;

/// The network; `seed` draws the weights where they are to be untrained. One that is to compute in int8
/// computes in f32 until it is [`calibrated`].
pub(crate) fn load(spec: &EncoderSpec, seed: u64) -> Result<Network> {
    match spec.network {
        NetworkSpec::Images(kind) => Ok(Network::Images(images(kind, spec, seed)?)),
        NetworkSpec::Sequences { frames } => {
            let network = match &spec.weights {
                WeightsSpec::BuiltIn => bail!("{}", no_weights(I3d::NAME)),
                WeightsSpec::Untrained => I3d::seeded(seed)?,
                WeightsSpec::File(path) => I3d::load(path)?,
            };
            ensure!(
                spec.precision == Precision::F32,
                "{} computes in {} alone",
                I3d::NAME,
                Precision::F32
            );
            Ok(Network::Sequences(network, frames))
        }
    }
}

fn images(kind: EncoderKind, spec: &EncoderSpec, seed: u64) -> Result<Encoder> {
    let encoder = match &spec.weights {
        WeightsSpec::BuiltIn => Encoder::new(kind, built_in(kind)?, &Device::Cpu)?,
        WeightsSpec::Untrained => Encoder::seeded(kind, seed, &Device::Cpu)?,
        WeightsSpec::File(path) => Encoder::load(kind, path, &Device::Cpu)?,
    };
    match spec.precision {
        Precision::Int8 => Ok(encoder),
        precision => Ok(encoder.with_precision(precision)?),
    }
}

/// The encoder in int8, its feature maps scaled by some of `count` frames, evenly spread.
pub(crate) fn calibrated(
    encoder: &Encoder,
    count: usize,
    frame: impl Fn(usize) -> Result<Frame> + Sync,
) -> Result<Encoder> {
    let some = count.min(CALIBRATION);
    let image = |i: usize| {
        let Frame {
            height,
            width,
            data,
        } = frame(i * count / some)?;
        let pixels = Tensor::from_vec(data, (1, height, width, 3), &Device::Cpu)?;
        Ok(pixels.permute((0, 3, 1, 2))?)
    };
    let images: Vec<Tensor> = (0..some)
        .into_par_iter()
        .map(image)
        .collect::<Result<_>>()?;
    let images: Vec<&Tensor> = images.iter().collect();
    Ok(encoder
        .clone()
        .calibrated(&images)?
        .with_precision(Precision::Int8)?)
}

fn built_in(kind: EncoderKind) -> Result<Weights> {
    let bytes = match kind {
        EncoderKind::EfficientNetLiteSmall => EFFICIENTNET_LITE_SMALL,
        EncoderKind::SeResNextSmall => SE_RESNEXT_SMALL,
        kind => bail!("{}", no_weights(kind.name())),
    };
    Ok(Weights::from_bytes("the built-in weights", bytes)?)
}

fn no_weights(network: &str) -> String {
    format!("no weights for {network} come with the project; name a file, or `untrained`")
}

/// The encoder in words, for reports.
pub(crate) fn describe(spec: &EncoderSpec) -> String {
    let weights = match &spec.weights {
        WeightsSpec::BuiltIn => "its built-in weights".to_owned(),
        WeightsSpec::Untrained => "untrained, random weights".to_owned(),
        WeightsSpec::File(path) => {
            let name = path.file_name().unwrap_or(path.as_os_str());
            format!("weights from {}", name.to_string_lossy())
        }
    };
    let trained = match spec.training.as_ref().map(|training| &training.objective) {
        Some(TrainingObjective::Linear {}) => ", then trained on each training part",
        Some(TrainingObjective::Heads { .. }) => {
            ", then trained through heads on each training part"
        }
        None => "",
    };
    let precision = match spec.precision {
        Precision::F32 => String::new(),
        precision => format!(" in {precision}"),
    };
    let frames = match (spec.network, spec.resize) {
        (NetworkSpec::Sequences { frames }, Some(pixels)) => {
            format!(", on {frames} equidistant frames of {pixels} pixels")
        }
        (NetworkSpec::Sequences { frames }, None) => format!(", on {frames} equidistant frames"),
        (NetworkSpec::Images(_), Some(pixels)) => format!(", on frames of {pixels} pixels"),
        (NetworkSpec::Images(_), None) => String::new(),
    };
    let name = spec.network.name();
    format!("{name}{precision} with {weights}{frames}{trained}")
}
