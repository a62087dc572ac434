//! Experiments on tactile properties from photographs: a config in, trials and scored results out.
//!
//! # What is where
//!
//! - [`config`] reads a TOML file into a checked [`config::Experiment`].
//! - [`run`] runs it, resumes it, does a part of it or says what is missing.
//! - [`results`] and [`predictions`] are what a run leaves in its folder.
//! - [`train`] fits the model that a config names, to be kept; [`own`] needs no config.
//! - [`training`] trains encoders.
//! - The rest is small and shared by the programs that show results: [`files`], [`checksums`], [`cells`],
//!   [`text`], [`progress`].
//!
//! A trial is a pure function of config, data and seed: the same trial gives the same bits, whatever the
//! number of threads, and a run that is stopped goes on where it was.
//!
//! Nothing is printed but progress: a bar on a terminal, lines of the log elsewhere.

pub mod cells;
pub mod checksums;
pub mod config;
pub mod data;
mod embeddings;
pub mod encoder;
pub mod files;
#[cfg(test)]
#[path = "../../../fixtures/fuzz/mod.rs"]
mod fuzz;
mod journal;
pub mod machine;
pub mod own;
pub mod paper;
pub mod predictions;
pub mod progress;
pub mod results;
pub mod run;
mod sequences;
pub mod text;
pub mod train;
pub mod training;
pub mod work;

/// The hash of the sources that decide what a trial comes to: finished trials and trained encoders of
/// other code are told apart by it.
pub const SOURCE_HASH: &str = env!("SOURCE_HASH");

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
