//! Tactile properties of surfaces from photographs of them: a fitted model that is kept as a folder,
//! read anywhere, and says with every estimate how far it can be trusted.
//!
//! # What is where
//!
//! - [`Recipe`] fits a [`Regression`] to embeddings, calibrates intervals and keeps the surfaces that
//!   familiarity is judged by. It gives a [`Fitted`].
//! - [`Estimator`] joins a [`Fitted`] and an [`Embedder`]: it reads, predicts, is saved and loaded.
//! - [`Session`] takes photographs one by one until the intervals are narrow enough.
//! - [`Watch`] notices when photographs are no longer like those of the fit.
//! - [`Estimator::map`] estimates at every place of a photograph.
//! - [`radius()`] is what intervals are made of.
//!
//! Nothing here prints or shows progress; what is random is fixed by a seed, and results
//! do not depend on the number of threads.
//!
//! # Features
//!
//! On by default: `clusters` fits and reads heads that learn from labels by k-means, `exr` reads photographs in
//! OpenEXR. `onnx` reads encoders from ONNX files.

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
/// A photograph.
pub use sps_dataset::Frame;
pub use sps_onnx::{OnnxEncoder, Settings as OnnxSettings};
pub use watch::Watch;

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
