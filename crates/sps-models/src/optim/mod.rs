//! The optimiser: Adam, and clipping of a gradient by its norm.

mod adam;
mod clip;
mod gradient;
#[cfg(test)]
mod tests;

pub(crate) use adam::Adam;
pub use adam::AdamConfig;
pub(crate) use clip::{clip_scales, squared_norms};
pub(crate) use gradient::Gradient;
