//! Experiment configs: TOML in, checked [`Experiment`]s out.

mod differing;
mod encoder;
mod estimator;
mod experiment;
mod grid;
mod grid_words;
mod layers;
mod list;
mod looks;
mod merge;
mod method;
mod schema;

pub use differing::{Differing, differing_keys};
pub use encoder::{EncoderSpec, Network, WeightsSpec};
pub use experiment::Experiment;
pub use layers::{ConfigError, Layers, Setting};
pub use list::list;

pub use crate::data::DataSpec;

pub(crate) use estimator::{Estimator, Given};
pub(crate) use looks::{Looks, Refit, Selected};
pub(crate) use method::Method;
pub(crate) use schema::{Adaptive, Config, JudgedOn, SpeedConfig};
