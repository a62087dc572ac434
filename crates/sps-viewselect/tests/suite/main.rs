//! Every test of the crate's public face, in one binary.

mod exhaustive;
mod hard_cases;
mod laws;
mod planted;
mod problems;
mod regret;
mod relations;
mod serde;
mod shared;
mod support;
mod threads;
mod uniform;
