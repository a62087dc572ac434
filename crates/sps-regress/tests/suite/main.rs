//! The crate from outside: one program, so that the library is compiled once.

mod data;
#[path = "../../../../fixtures/golden/rule.rs"]
mod golden;
mod kernel_ridge;
mod nearest;
mod pca;
mod ridge;
mod stacking;
mod support;
