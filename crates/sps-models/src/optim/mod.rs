//! The optimiser: Adam, and clipping of a gradient by its norm.
//!
//! ```
//! use candle_core::{Device, Var};
//! use sps_models::optim::{Adam, AdamConfig};
//!
//! let point = Var::new(&[3.0_f64, -2.0], &Device::Cpu)?;
//! let config = AdamConfig { learning_rate: 0.1, ..AdamConfig::default() };
//! let mut adam = Adam::new(config, [point.clone()])?;
//! for _ in 0..200 {
//!     let loss = point.sqr()?.sum_all()?;
//!     let gradients = loss.backward()?;
//!     let gradient = gradients.get(&point).cloned().into_iter().collect::<Vec<_>>();
//!     adam.step(&gradient, &[])?;
//! }
//! assert!(point.to_vec1::<f64>()?.iter().all(|value| value.abs() < 0.01));
//! # Ok::<(), sps_models::Error>(())
//! ```

mod adam;
mod clip;
mod gradient;
#[cfg(test)]
mod tests;

pub use adam::{Adam, AdamConfig};
pub(crate) use clip::{clip_scales, squared_norms};
pub use gradient::{Elements, Gradient};
