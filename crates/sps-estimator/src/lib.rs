#![doc = include_str!("../README.md")]

mod artefact;
mod embedder;
mod error;
mod estimator;
mod fitted;
mod map;
mod novelty;
mod precomputed;
mod radius;
mod recipe;
mod regression;
mod session;
mod step;
mod watch;

pub use embedder::{Embedder, Network, photographs_in, read_photograph};
pub use error::{Error, Result};
pub use estimator::{About, Answer, Described, Estimate, Estimator, Measured, Near, Scale};
pub use fitted::{Fitted, FittedOn, Predicted, Predictions};
pub use map::{Map, Sight};
pub use novelty::Shown;
pub use precomputed::Precomputed;
pub use radius::radius;
pub use recipe::{Calibration, Examples, Recipe, Wanted, Widths};
pub use regression::{Regression, Stacked, early_stopped};
pub use session::{Looked, Session};
pub use sps_base::Unexpected;
/// A photograph.
pub use sps_dataset::Frame;
pub use sps_onnx::{OnnxEncoder, Settings as OnnxSettings};
pub use watch::Watch;
