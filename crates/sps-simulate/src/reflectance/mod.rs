//! How light leaves a surface: lobes, their energy, the dome and the layered model.

mod brdf;
mod dome;
mod energy;
mod ggx;
mod sheen;

pub use brdf::{Brdf, Vector};
pub(crate) use brdf::{COAT_F0, multiple_colour};
pub(crate) use dome::DOME;
pub(crate) use energy::energy;
pub(crate) use ggx::{Spread, schlick, slope_density, visibility};
pub(crate) use sheen::{sheen_lobe, sheen_table};
