//! What turns frames into embeddings.

use std::path::PathBuf;

use sps_estimator::OnnxSettings;
use sps_models::encoders::{Depths, EncoderKind, Precision};
use sps_models::training::TrainingConfig;

use super::layers::Layers;
use super::locate::ConfigError;
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
    let network = network(layers, key, encoder)?;
    if let Network::Sequences { frames, .. } = network {
        let at = |field: &str| format!("{key}.{field}");
        layers.require(frames > 0, &at("frames"), "must be at least 1")?;
        let one = !encoder.trainable || encoder.training.objective.views() == 1;
        let why = "looks at several views; an encoder of sequences sees one sequence";
        layers.require(one, &at("training.objective"), why)?;
    }
    let precision = encoder.precision.parse::<Precision>();
    let precision =
        precision.map_err(|error| layers.error(&format!("{key}.precision"), error.to_string()))?;
    check_training(layers, &format!("{key}.training"), &encoder.training)?;
    let weights = WeightsSpec::named(&encoder.weights);
    if let Some(kind) = network.kind() {
        check_depths(layers, &format!("{key}.depths"), kind, &encoder.depths)?;
        if weights == WeightsSpec::BuiltIn {
            kind.check_built_in()
                .map_err(|error| layers.error(&format!("{key}.weights"), error.to_string()))?;
        }
    } else {
        let why = "has no meaning beside `onnx` or `embeddings`";
        let untouched = [
            ("trainable", !encoder.trainable),
            ("precision", precision == Precision::F32),
            ("depths", encoder.depths == Depths::All),
            ("weights", weights == WeightsSpec::BuiltIn),
        ];
        for (field, untouched) in untouched {
            layers.require(untouched, &format!("{key}.{field}"), why)?;
        }
    }
    Ok(EncoderSpec {
        network,
        depths: encoder.depths.clone(),
        weights,
        precision,
        resize: (encoder.resize > 0).then_some(encoder.resize),
        training: encoder.trainable.then(|| encoder.training.clone()),
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
        let given = [
            ("outputs", encoder.outputs.is_some()),
            ("size", encoder.size.is_some()),
            ("mean", encoder.mean.is_some()),
            ("std", encoder.std.is_some()),
        ];
        for (field, given) in given {
            layers.require(!given, &at(field), "needs `onnx`, the file of the network")?;
        }
        if let Some(file) = &encoder.embeddings {
            return Ok(Network::Precomputed(file.clone()));
        }
        let network = Network::named(&encoder.name, encoder.frames);
        return network.map_err(|error| layers.error(&at("name"), error.to_string()));
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

/// Refuses depths that a network does not have.
///
/// # Errors
/// A stage that the network does not have, with the line of the key.
pub fn check_depths(
    layers: &Layers<'_>,
    key: &str,
    kind: EncoderKind,
    depths: &Depths,
) -> Result<(), ConfigError> {
    let refused = |error| match error {
        sps_models::Error::Input {
            found, expected, ..
        } => layers.error(key, format!("is {found}, expected {expected}")),
        other => layers.error(key, other.to_string()),
    };
    kind.blocks(depths).map(drop).map_err(refused)
}

/// Refuses a training that cannot be, at the line of its first such key.
///
/// # Errors
/// A value that cannot be meant, with the line of its key.
pub fn check_training(
    layers: &Layers<'_>,
    table: &str,
    training: &TrainingConfig,
) -> Result<(), ConfigError> {
    let refused = |error| match error {
        sps_models::Error::Input {
            what,
            found,
            expected,
        } => {
            let problem = format!("is {found}, expected {expected}");
            layers.error(&format!("{table}.{what}"), problem)
        }
        other => layers.error(table, other.to_string()),
    };
    training.check().map_err(refused)
}
