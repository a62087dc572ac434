//! What turns frames into embeddings.

use std::path::PathBuf;

use sps_estimator::OnnxSettings;
use sps_models::encoders::{Depths, EncoderKind, Precision};
use sps_models::training::TrainingConfig;

use super::layers::{ConfigError, Layers};
use super::schema::EncoderConfig;

/// An encoder as methods use it.
#[derive(Clone, Debug, PartialEq)]
pub struct EncoderSpec {
    /// Its layers.
    pub network: Network,
    /// The stages whose maps make an embedding.
    pub depths: Depths,
    /// What it begins with.
    pub weights: WeightsSpec,
    /// What it computes in.
    pub precision: Precision,
    /// Pixels of the shorter side.
    pub resize: Option<usize>,
    /// How it is trained on the training part of each rerun; `None` leaves it as it is.
    pub training: Option<TrainingConfig>,
}

impl EncoderSpec {
    /// Whether what surfaces a rerun trains on makes it another encoder: it is trained on them, or
    /// scaled for them to compute in int8.
    pub(crate) fn learns(&self) -> bool {
        self.training.is_some() || self.precision == Precision::Int8
    }
}

/// What turns frames into embeddings.
#[derive(Clone, Debug, PartialEq)]
pub enum Network {
    /// A network that takes one frame.
    Images(EncoderKind),
    /// A network that takes a sequence of so many.
    Sequences {
        /// The network.
        kind: EncoderKind,
        /// Frames of a sequence.
        frames: usize,
    },
    /// The network in an ONNX file.
    Onnx(PathBuf, OnnxSettings),
    /// None: a file has the embeddings.
    Precomputed(PathBuf),
}

impl Network {
    /// The network of this name; `frames` is the length of a sequence.
    ///
    /// # Errors
    /// A name that is not known, with the nearest.
    pub fn named(name: &str, frames: usize) -> Result<Self, sps_models::Error> {
        let kind: EncoderKind = name.parse()?;
        Ok(if kind.takes_sequences() {
            Self::Sequences { kind, frames }
        } else {
            Self::Images(kind)
        })
    }

    pub(crate) const fn kind(&self) -> Option<EncoderKind> {
        match self {
            Self::Images(kind) | Self::Sequences { kind, .. } => Some(*kind),
            Self::Onnx(..) | Self::Precomputed(_) => None,
        }
    }
}

/// The weights that an encoder begins with.
#[derive(Clone, Debug, PartialEq)]
pub enum WeightsSpec {
    /// Those that come with the project.
    BuiltIn,
    /// Random ones.
    Untrained,
    /// Those in a file.
    File(PathBuf),
}

impl WeightsSpec {
    /// `built-in`, `untrained`, or a file.
    pub fn named(name: &str) -> Self {
        match name {
            "built-in" => Self::BuiltIn,
            "untrained" => Self::Untrained,
            path => Self::File(PathBuf::from(path)),
        }
    }
}

pub(super) fn encoder(
    layers: &Layers<'_>,
    key: &str,
    encoder: &EncoderConfig,
) -> Result<EncoderSpec, ConfigError> {
    let at = |field: &str| format!("{key}.{field}");
    let network = network(layers, key, encoder)?;
    if let Network::Sequences { frames, .. } = network {
        layers.require(frames > 0, &at("frames"), "must be at least 1")?;
        let one = !encoder.trainable || encoder.training.objective.views() == 1;
        let why = "looks at several views; an encoder of sequences sees one sequence";
        layers.require(one, &at("training.objective"), why)?;
    }
    let precision = layers.named(&at("precision"), encoder.precision.parse::<Precision>())?;
    layers.checked(&at("training"), encoder.training.check())?;
    let weights = WeightsSpec::named(&encoder.weights);
    if let Some(kind) = network.kind() {
        layers.checked(key, kind.blocks(&encoder.depths))?;
        if weights == WeightsSpec::BuiltIn {
            layers.named(&at("weights"), kind.check_built_in())?;
        }
    } else {
        let why = "has no meaning beside `onnx` or `embeddings`";
        for (field, untouched) in [
            ("trainable", !encoder.trainable),
            ("precision", precision == Precision::F32),
            ("depths", encoder.depths == Depths::All),
            ("weights", weights == WeightsSpec::BuiltIn),
        ] {
            layers.require(untouched, &at(field), why)?;
        }
    }
    let begun = || {
        let random = weights == WeightsSpec::Untrained;
        encoder.training.clone().beginning(random)
    };
    Ok(EncoderSpec {
        training: encoder.trainable.then(begun),
        network,
        depths: encoder.depths.clone(),
        weights,
        precision,
        resize: (encoder.resize > 0).then_some(encoder.resize),
    })
}

/// What the table at `key` names: an encoder, an ONNX file, or a file of embeddings.
fn network(
    layers: &Layers<'_>,
    key: &str,
    encoder: &EncoderConfig,
) -> Result<Network, ConfigError> {
    let at = |field: &str| format!("{key}.{field}");
    let Some(file) = &encoder.onnx else {
        for (field, given) in [
            ("outputs", encoder.outputs.is_some()),
            ("size", encoder.size.is_some()),
            ("mean", encoder.mean.is_some()),
            ("std", encoder.std.is_some()),
        ] {
            layers.require(!given, &at(field), "needs `onnx`, the file of the network")?;
        }
        return match &encoder.embeddings {
            Some(file) => Ok(Network::Precomputed(file.clone())),
            None => layers.named(&at("name"), Network::named(&encoder.name, encoder.frames)),
        };
    };
    let alone = encoder.embeddings.is_none();
    layers.require(alone, &at("embeddings"), "has no meaning beside `onnx`")?;
    let default = OnnxSettings::default();
    let settings = OnnxSettings {
        outputs: encoder.outputs.clone().unwrap_or(default.outputs),
        size: encoder.size,
        mean: encoder.mean.unwrap_or(default.mean),
        std: encoder.std.unwrap_or(default.std),
    };
    Ok(Network::Onnx(file.clone(), settings))
}
