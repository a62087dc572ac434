//! The encoder that a config asks for.

use anyhow::{Result, bail, ensure};
use candle_core::{Device, Tensor};
use sps_models::encoders::{Embed, Encoder, EncoderKind, I3d, Precision};
use sps_models::weights::Weights;

use crate::config::{EncoderSpec, Network, WeightsSpec};

/// Trained by `pretrain configs/pretrain.toml`.
const SE_RESNEXT_SMALL: &[u8] =
    include_bytes!("../../fixtures/encoders/se-resnext-small.safetensors");

/// A network with its weights.
#[derive(Clone)]
pub(crate) enum Loaded {
    /// Embeds images one by one.
    Images(Encoder),
    /// Embeds sequences of so many images.
    Sequences(I3d, usize),
}

impl Loaded {
    /// The network; `seed` draws the weights where they are to be untrained.
    pub(crate) fn new(spec: &EncoderSpec, seed: u64) -> Result<Self> {
        match spec.network {
            Network::Images(kind) => Ok(Self::Images(images(kind, spec, seed)?)),
            Network::Sequences { frames } => {
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
                Ok(Self::Sequences(network, frames))
            }
        }
    }

    fn network(&self) -> &dyn Embed {
        match self {
            Self::Images(encoder) => encoder,
            Self::Sequences(network, _) => network,
        }
    }

    /// The network's name.
    pub(crate) fn name(&self) -> &'static str {
        self.network().name()
    }

    /// The network where it embeds single images.
    pub(crate) fn of_images(&self) -> Result<&Encoder> {
        match self {
            Self::Images(encoder) => Ok(encoder),
            Self::Sequences(..) => bail!(
                "{} embeds sequences; expected an encoder of single images",
                I3d::NAME
            ),
        }
    }

    /// Images that are embedded as one.
    pub(crate) fn frames(&self) -> usize {
        match self {
            Self::Images(_) => 1,
            Self::Sequences(_, frames) => *frames,
        }
    }

    /// The length of an embedding.
    pub(crate) fn width(&self) -> usize {
        self.network().width()
    }

    /// A hash of the network and every weight.
    pub(crate) fn content_hash(&self) -> [u8; 32] {
        self.network().content_hash()
    }

    /// Multiply-adds to embed an image of this size, where they are known.
    pub(crate) fn multiply_adds(&self, height: usize, width: usize) -> Option<u64> {
        match self {
            Self::Images(encoder) => encoder.kind().multiply_adds(height, width),
            Self::Sequences(..) => None,
        }
    }

    /// Embeds `n * frames` images, each `(height, width, 3)`, row-major, to `(n, width)`.
    pub(crate) fn embed(&self, images: &[&[f32]], size: [usize; 2]) -> Result<Vec<f32>> {
        match self {
            Self::Images(encoder) => Ok(encoder.embed_pixels(images, size)?),
            Self::Sequences(network, frames) => {
                let [height, width] = size;
                let shape = (images.len() / frames, *frames, height, width, 3);
                let sequences = Tensor::from_vec(images.concat(), shape, &Device::Cpu)?;
                let embeddings = network.embed(&sequences.permute((0, 4, 1, 2, 3))?)?;
                Ok(embeddings.flatten_all()?.to_vec1()?)
            }
        }
    }
}

fn images(kind: EncoderKind, spec: &EncoderSpec, seed: u64) -> Result<Encoder> {
    let encoder = match &spec.weights {
        WeightsSpec::BuiltIn => Encoder::new(kind, built_in(kind)?, &Device::Cpu)?,
        WeightsSpec::Untrained => Encoder::seeded(kind, seed, &Device::Cpu)?,
        WeightsSpec::File(path) => Encoder::load(kind, path, &Device::Cpu)?,
    };
    Ok(encoder.with_precision(spec.precision)?)
}

fn built_in(kind: EncoderKind) -> Result<Weights> {
    match kind {
        EncoderKind::SeResNextSmall => Ok(Weights::from_bytes(
            "the built-in weights",
            SE_RESNEXT_SMALL,
        )?),
        kind => bail!("{}", no_weights(kind.name())),
    }
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
    let trained = match spec.training {
        Some(_) => ", then trained on each training part",
        None => "",
    };
    let precision = match spec.precision {
        Precision::F32 => String::new(),
        precision => format!(" in {precision}"),
    };
    let frames = match (spec.network, spec.resize) {
        (Network::Sequences { frames }, Some(pixels)) => {
            format!(", on {frames} equidistant frames of {pixels} pixels")
        }
        (Network::Sequences { frames }, None) => format!(", on {frames} equidistant frames"),
        (Network::Images(_), Some(pixels)) => format!(", on frames of {pixels} pixels"),
        (Network::Images(_), None) => String::new(),
    };
    let name = spec.network.name();
    format!("{name}{precision} with {weights}{frames}{trained}")
}
