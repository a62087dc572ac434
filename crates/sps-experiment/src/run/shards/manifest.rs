//! What a shard is a part of.

use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use toml::Table;

use crate::checksums;
use crate::config::{Experiment, differing_keys};
use crate::machine::processor;
use crate::work::Shard;

const MANIFEST: &str = "shard.json";

/// Everything that the shards of one experiment have in common, beside which of them it is.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Manifest {
    shard: String,
    /// Whether all that was dealt to it is done.
    pub ended: bool,
    methods: Vec<String>,
    source_hash: String,
    data_hash: String,
    cpu: String,
    config: String,
}

impl Manifest {
    pub(super) fn new(experiment: &Experiment, shard: Shard, data_hash: &blake3::Hash) -> Self {
        let methods = experiment.methods.iter();
        Self {
            shard: shard.to_string(),
            ended: false,
            methods: methods.map(|method| method.id.clone()).collect(),
            source_hash: env!("SOURCE_HASH").to_owned(),
            data_hash: data_hash.to_string(),
            cpu: processor(),
            config: experiment.resolved.clone(),
        }
    }

    /// That in the folder of a shard; none where it never got so far, or it is damaged.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(MANIFEST);
        let Some(bytes) = checksums::read(&path)? else {
            return Ok(None);
        };
        let read = serde_json::from_slice(&bytes);
        read.with_context(|| format!("cannot read {}", path.display()))
    }

    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        let bytes = serde_json::to_vec_pretty(self)?;
        checksums::write(&folder.join(MANIFEST), &bytes)
    }

    /// What is not as this experiment has it: the first difference, in words.
    pub(super) fn other_than(
        &self,
        experiment: &Experiment,
        data_hash: &blake3::Hash,
    ) -> Result<Option<String>> {
        let here = env!("SOURCE_HASH");
        if self.source_hash != here {
            let there = &self.source_hash;
            return Ok(Some(format!("other sources: `{there}`, here `{here}`")));
        }
        let methods = experiment.methods.iter();
        let methods: Vec<&str> = methods.map(|method| method.id.as_str()).collect();
        if self.methods != methods {
            let (there, here) = (self.methods.join(", "), methods.join(", "));
            return Ok(Some(format!("other methods: {there}; here {here}")));
        }
        let [there, here] = [&self.config, &experiment.resolved].map(|text| text.parse());
        let (mut there, mut here): (Table, Table) = (there?, here?);
        // Where embeddings are kept decides nothing.
        for config in [&mut there, &mut here] {
            config.remove("cache");
        }
        if let Some(first) = differing_keys(&there, &here).first() {
            return Ok(Some(format!("another config: {first}")));
        }
        let (there, here) = (&self.data_hash, data_hash.to_string());
        let other = *there != here;
        Ok(other.then(|| format!("other data: `data_hash` is {there}, here {here}")))
    }
}
