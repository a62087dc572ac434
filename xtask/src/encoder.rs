//! The encoder that a config asks for.

use anyhow::{Result, bail};
use candle_core::Device;
use sps_models::encoders::{Encoder, EncoderKind, Precision};
use sps_models::weights::Weights;

use crate::config::{EncoderSpec, WeightsSpec};

/// Trained by `pretrain configs/pretrain.toml`.
const SE_RESNEXT_SMALL: &[u8] =
    include_bytes!("../../fixtures/encoders/se-resnext-small.safetensors");

/// Loads the encoder; `seed` draws the weights where they are to be untrained.
pub(crate) fn load(spec: &EncoderSpec, seed: u64) -> Result<Encoder> {
    let encoder = match &spec.weights {
        WeightsSpec::BuiltIn => Encoder::new(spec.kind, built_in(spec.kind)?, &Device::Cpu)?,
        WeightsSpec::Untrained => Encoder::seeded(spec.kind, seed, &Device::Cpu)?,
        WeightsSpec::File(path) => Encoder::load(spec.kind, path, &Device::Cpu)?,
    };
    Ok(encoder.with_precision(spec.precision)?)
}

fn built_in(kind: EncoderKind) -> Result<Weights> {
    match kind {
        EncoderKind::SeResNextSmall => Ok(Weights::from_bytes(
            "the built-in weights",
            SE_RESNEXT_SMALL,
        )?),
        kind => bail!("no weights for {kind} come with the project; name a file"),
    }
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
    let trained = match spec.training {
        Some(_) => ", then trained on each training part",
        None => "",
    };
    let precision = match spec.precision {
        Precision::F32 => String::new(),
        precision => format!(" in {precision}"),
    };
    let resized = match spec.resize {
        Some(pixels) => format!(", on frames of {pixels} pixels"),
        None => String::new(),
    };
    format!("{}{precision} with {weights}{resized}{trained}", spec.kind)
}
