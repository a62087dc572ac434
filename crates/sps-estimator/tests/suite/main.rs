//! The tests that need no feature and damage no file, in one binary.

mod estimator;
mod exchangeable;
mod familiar;
mod friction_photos;
mod new_groups;
mod precomputed;
#[path = "../support/mod.rs"]
mod support;
mod watch;
