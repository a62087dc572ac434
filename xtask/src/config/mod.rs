//! Experiment configs: TOML in, checked [`Experiment`]s out.

mod adaptive;
mod data;
mod encoder;
mod estimator;
mod experiment;
mod grid;
mod grid_words;
mod layers;
mod list;
mod locate;
mod looks;
mod merge;
mod method;
mod pretrain;
mod report;
mod schema;
mod setting;
mod written;

pub(crate) use adaptive::in_order;
pub(crate) use data::{DataSpec, Protocol, TestSurfaces};
pub(crate) use encoder::{EncoderSpec, Network, WeightsSpec};
pub(crate) use estimator::{Estimator, Given};
pub(crate) use experiment::Experiment;
pub(crate) use list::list;
pub(crate) use looks::{Looks, Refit, Selected};
pub(crate) use method::Method;
pub(crate) use pretrain::{PatternsSpec, Pretraining, TeacherSpec};
pub(crate) use schema::{Adaptive, JudgedOn, SpeedConfig};
pub(crate) use setting::Setting;
