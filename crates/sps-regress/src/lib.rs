#![doc = include_str!("../README.md")]

mod archive;
mod data;
pub mod dense;
mod error;
mod fitted;
#[cfg(test)]
#[path = "../../../fixtures/golden/rule.rs"]
#[allow(dead_code, reason = "how far results are off is told otherwise here")]
mod golden;
mod groups;
pub mod kernel_ridge;
mod left_out;
pub mod nearest;
mod pca;
mod plan;
mod regressor;
pub mod ridge;
pub mod stacking;
mod standardise;

pub use data::{Embeddings, Readings, Spread, check_indices, places};
pub use error::{Error, Result};
pub use fitted::Fitted;
pub use pca::Pca;
pub use plan::{Plan, Rerun, TrainingData, Trial, Views};
pub use regressor::{
    AnyRegressor, DivergedTrial, Estimates, FittedRegressor, OtherKind, Read, Regressor,
    RegressorKind, RegressorSettings, fitted_from_bytes,
};
pub use sps_base::Unexpected;
pub use standardise::Standardiser;
