//! Every test of the crate's public face, in one binary.

mod data;
#[path = "../../../../fixtures/golden/rule.rs"]
mod golden;
mod kernel_ridge;
mod nearest;
mod pca;
mod ridge;
mod stacking;
mod support;
