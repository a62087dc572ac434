//! Experiment configs: TOML in, checked [`Experiment`]s out.

mod adaptive;
mod data;
mod estimator;
mod experiment;
mod list;
mod locate;
mod looks;
mod merge;
mod pretrain;
mod schema;
mod sweep;

pub(crate) use adaptive::{Adaptive, AdaptiveKey, in_order};
pub(crate) use data::{DataSpec, Protocol, TestSurfaces};
pub(crate) use estimator::Estimator;
pub(crate) use experiment::{EncoderSpec, Experiment, Method, Network, SpeedSpec, WeightsSpec};
pub(crate) use list::list;
pub(crate) use locate::Setting;
pub(crate) use looks::{Looks, Refit, Selected};
pub(crate) use pretrain::Pretraining;
pub(crate) use schema::{JudgedOn, SelectorConfig};
