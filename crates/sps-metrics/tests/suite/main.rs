//! Every test of the crate's public face, in one binary.

mod conformal;
mod golden;
mod group_conformal;
mod hard_cases;
mod intervals;
mod laws;
mod paper;
mod properties;
mod reasons;
#[cfg(feature = "serde")]
mod serde;
mod support;
