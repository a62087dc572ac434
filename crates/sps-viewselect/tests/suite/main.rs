//! Every test of the crate's public face, in one binary.

mod exhaustive;
mod hard_cases;
mod laws;
mod problems;
mod relations;
mod searches;
mod serde;
mod shared;
mod support;
