//! Experiment configs: TOML in, checked [`Experiment`]s out.

mod adaptive;
mod experiment;
mod locate;
mod looks;
mod pretrain;
mod schema;
mod sweep;

pub(crate) use adaptive::{Adaptive, AdaptiveKey, in_order};
pub(crate) use experiment::{
    DataSpec, EncoderSpec, Estimator, Experiment, Method, Network, SpeedSpec, WeightsSpec,
};
pub(crate) use locate::Setting;
pub(crate) use looks::{Looks, Selected};
pub(crate) use pretrain::Pretraining;
pub(crate) use schema::SelectorConfig;
