//! A simulated gonioreflectometer and tactile sensor (feature `simulate`).
//!
//! Surfaces of 45 materials, photographed at any roll angle and touched as the paper's were. A
//! [`Simulator`] is a [`Source`](crate::Source) like a dataset on disk. The model, its ranges,
//! their sources and what was measured on it are in the repository's `docs/simulator.md`.

mod ceiling;
mod fingerprint;
mod geometry;
mod grid;
mod latent;
mod material;
mod numeric;
mod parameters;
mod reflectance;
mod relief;
mod render;
mod simulator;
mod spec;
mod stream;
mod touch;

pub use ceiling::{Ceiling, Ceilings, ceilings};
pub use latent::{Latent, Scores, Visibility};
pub use material::{Material, Palette, Profile, Range, Structure, Weave};
pub use parameters::Parameters;
pub use reflectance::{Brdf, Vector};
pub use simulator::Simulator;
pub use spec::{SimulateError, SimulatorSpec};
