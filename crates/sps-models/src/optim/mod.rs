//! The optimiser: Adam, and clipping of a gradient by its norm.

mod adam;
mod clip;
mod gradient;
#[cfg(test)]
mod tests;

pub use adam::{Adam, AdamConfig};
pub use clip::{clip_scales, squared_norms};
pub use gradient::{Elements, Gradient};
