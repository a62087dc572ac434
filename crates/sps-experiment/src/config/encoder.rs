//! What turns frames into embeddings.

use std::path::PathBuf;

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
#[derive(Clone, Copy, Debug, PartialEq)]
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

    pub(crate) const fn kind(self) -> EncoderKind {
        match self {
            Self::Images(kind) | Self::Sequences { kind, .. } => kind,
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

/// The encoder of the table at `key`.
pub(super) fn encoder(
    layers: &Layers<'_>,
    key: &str,
    encoder: &EncoderConfig,
) -> Result<EncoderSpec, ConfigError> {
    let network = Network::named(&encoder.name, encoder.frames);
    let network =
        network.map_err(|error| layers.error(&format!("{key}.name"), error.to_string()))?;
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
    check_depths(
        layers,
        &format!("{key}.depths"),
        network.kind(),
        &encoder.depths,
    )?;
    check_training(layers, &format!("{key}.training"), &encoder.training)?;
    let weights = WeightsSpec::named(&encoder.weights);
    if weights == WeightsSpec::BuiltIn {
        network
            .kind()
            .check_built_in()
            .map_err(|error| layers.error(&format!("{key}.weights"), error.to_string()))?;
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
    match kind.blocks(depths) {
        Ok(_) => Ok(()),
        Err(sps_models::Error::Input {
            found, expected, ..
        }) => Err(layers.error(key, format!("is {found}, expected {expected}"))),
        Err(other) => Err(layers.error(key, other.to_string())),
    }
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
    match training.check() {
        Ok(()) => Ok(()),
        Err(sps_models::Error::Input {
            what,
            found,
            expected,
        }) => {
            let problem = format!("is {found}, expected {expected}");
            Err(layers.error(&format!("{table}.{what}"), problem))
        }
        Err(other) => Err(layers.error(table, other.to_string())),
    }
}
