//! The encoder that a config asks for.

use anyhow::{Result, bail};
use candle_core::Device;
use sps_models::encoders::Encoder;

use crate::config::{EncoderSpec, WeightsSpec};
use crate::embeddings::Embedder;

/// Loads the encoder; `seed` draws the weights where they are to be untrained.
pub(crate) fn load(spec: &EncoderSpec, seed: u64) -> Result<Encoder> {
    Ok(match &spec.weights {
        WeightsSpec::BuiltIn => bail!("no weights for {} come with the project", spec.kind),
        WeightsSpec::Untrained => Encoder::seeded(spec.kind, seed, &Device::Cpu)?,
        WeightsSpec::File(path) => Encoder::load(spec.kind, path, &Device::Cpu)?,
    })
}

/// The encoder together with the way frames are prepared for it.
pub(crate) fn embedder(spec: &EncoderSpec, seed: u64) -> Result<Embedder> {
    Embedder::new(load(spec, seed)?, spec.resize)
}

/// The encoder in words, for reports.
pub(crate) fn describe(spec: &EncoderSpec) -> String {
    match &spec.weights {
        WeightsSpec::BuiltIn => format!("{} with its built-in weights", spec.kind),
        WeightsSpec::Untrained => format!("{} with untrained, random weights", spec.kind),
        WeightsSpec::File(path) => {
            let name = path.file_name().unwrap_or(path.as_os_str());
            format!("{} with weights from {}", spec.kind, name.to_string_lossy())
        }
    }
}
