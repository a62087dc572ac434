//! Experiment configs: TOML in, checked [`Experiment`]s out.

mod experiment;
mod locate;
mod looks;
mod pretrain;
mod schema;

pub(crate) use experiment::{DataSpec, EncoderSpec, Estimator, Experiment, Method, WeightsSpec};
pub(crate) use locate::Setting;
pub(crate) use looks::{Looks, Selected};
pub(crate) use pretrain::Pretraining;
pub(crate) use schema::SelectorConfig;
