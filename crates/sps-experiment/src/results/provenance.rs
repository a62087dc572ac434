//! What results were computed from and with.

use serde::{Deserialize, Serialize};

/// The version of `results.json`: it rises when keys are added, which is all that ever happens.
pub(crate) const SCHEMA: u32 = 4;

/// At the top of `results.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Provenance {
    /// Version of this file: it rises when keys are added, which is all that ever happens.
    pub schema: u32,
    /// Hash of the sources that decide what a trial comes to, and of `Cargo.lock`. Trials of
    /// other sources are computed again.
    pub source_hash: String,
    /// BLAKE3 of `config.toml` in the folder of the run: the config with its defaults and all that
    /// was set on the command line.
    pub config_hash: String,
    /// BLAKE3 of the data: of each surface its name, group, material, averaged readings and
    /// the frame straight down, and the roll angles of the views.
    pub data_hash: String,
    /// Keys every random stream of the experiment.
    pub seed: u64,
    /// Seed of the simulated surfaces; `null` where the data is on disk.
    pub data_seed: Option<u64>,
    /// Model of the processor.
    pub cpu: String,
    /// Threads that computed; no result but times and memory depends on them.
    pub threads: usize,
    /// What the encoders of the methods compute in. Everything after an encoder is in f32, the
    /// scores in f64.
    pub precision: Vec<String>,
}
