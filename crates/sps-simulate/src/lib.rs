#![doc = include_str!("../README.md")]

mod ceiling;
mod fingerprint;
mod geometry;
mod grid;
mod latent;
mod material;
mod numeric;
mod parameters;
mod patterns;
mod reflectance;
mod relief;
mod render;
mod simulator;
mod spec;
mod stream;
mod touch;

pub use ceiling::{Ceiling, Ceilings, ceilings};
pub use material::Material;
pub use parameters::Parameters;
pub use patterns::Patterns;
pub use reflectance::{Brdf, Vector};
pub use simulator::Simulator;
pub use spec::{SimulateError, SimulatorSpec};
