//! Trained heads as safetensors: the tensors of head `i` are named `i/<parameter>`, and the
//! metadata hold the configuration and what each head was trained for.

use candle_core::{Device, Tensor};
use serde::{Deserialize, Serialize};
use sps_regress::{DivergedTrial, Standardiser, Trial};

use super::Head;
use super::config::HeadConfig;
use super::input::InputStatistics;
use super::network::{self, Dims};
use super::trained::{EpochLosses, KeptEpoch, TrainedHead, TrainedHeads};
use crate::error::{Error, Result};
use crate::weights::{Storage, TensorSpec, Weights, WeightsError, WeightsErrorKind};

/// The one key of the metadata: several would be written in an order that changes.
const KEY: &str = "sps-heads";
/// The version of the format.
const FORMAT: u32 = 1;
const MEAN: &str = "input.mean";
const FACTOR: &str = "input.factor";

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Metadata {
    format: u32,
    config: HeadConfig,
    heads: Vec<HeadMetadata>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    diverged: Vec<DivergedTrial>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct HeadMetadata {
    trial: Trial,
    /// Features of one view's embedding.
    width: usize,
    /// Classes of the auxiliary classifier.
    classes: usize,
    /// Mean and standard deviation of the training readings.
    target_mean: f64,
    target_std: f64,
    history: Vec<EpochLosses>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    kept: Option<KeptEpoch>,
}

impl TrainedHeads {
    /// The file's content; the same heads give the same bytes.
    ///
    /// # Errors
    /// A parameter that is not finite.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let metadata = Metadata {
            format: FORMAT,
            config: self.head.config().clone(),
            heads: self.heads.iter().map(HeadMetadata::of).collect(),
            diverged: self.diverged.clone(),
        };
        let metadata = serde_json::to_string(&metadata)
            .map_err(|error| Error::input("trained heads", error, "numbers that JSON has"))?;
        let mut tensors = Vec::new();
        for (at, head) in self.heads.iter().enumerate() {
            let InputStatistics { mean, factor } = &head.statistics;
            for (name, values) in [(MEAN, mean), (FACTOR, factor)] {
                let tensor = Tensor::from_slice(values, values.len(), &Device::Cpu)?;
                tensors.push((format!("{at}/{name}"), tensor));
            }
            let parameters = head.parameters.iter();
            tensors.extend(parameters.map(|(name, t)| (format!("{at}/{name}"), t.clone())));
        }
        let tensors = Weights::from_tensors("trained heads", tensors)?;
        Ok(tensors.to_bytes_as(Storage::F32, Some((KEY, &metadata)))?)
    }

    /// Reads the content of a file; `name` stands for it in error messages.
    ///
    /// # Errors
    /// Metadata that are missing, of another format or not valid; a tensor that is missing, of
    /// another shape than the configuration asks for, not finite, or not asked for.
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self> {
        let metadata = read_metadata(name, bytes)?;
        let head = Head::new(metadata.config)?;
        let tensors = check(name, bytes, head.config(), &metadata.heads)?;
        let heads = metadata.heads.into_iter().enumerate();
        let heads = heads.map(|(at, one)| one.with(head.config(), tensors.part(&format!("{at}/"))));
        Ok(Self {
            heads: heads.collect::<Result<_>>()?,
            head,
            diverged: metadata.diverged,
        })
    }
}

fn read_metadata(name: &str, bytes: &[u8]) -> Result<Metadata> {
    let text = Weights::note(name, bytes, KEY)?;
    let metadata: Metadata =
        serde_json::from_str(&text).map_err(|error| refused(name, format!("metadata: {error}")))?;
    if metadata.format != FORMAT {
        let found = metadata.format;
        return Err(refused(name, format!("format: found {found}, expected {FORMAT}")).into());
    }
    Ok(metadata)
}

/// The tensors, when they are those that the heads have.
fn check(name: &str, bytes: &[u8], config: &HeadConfig, heads: &[HeadMetadata]) -> Result<Weights> {
    const NETWORK: &str = "trained heads";
    let tensors = Weights::from_bytes(name, bytes)?;
    let mut specs = Vec::new();
    for (at, head) in heads.iter().enumerate() {
        let statistics = [MEAN, FACTOR].map(|name| (format!("{at}/{name}"), [head.width]));
        specs.extend(statistics.map(|(name, shape)| TensorSpec::new(name, &shape)));
    }
    // Once there are as many features, the sizes made of their number are no larger than memory.
    tensors.clone().fit(NETWORK, &specs, |_| true)?;
    for (at, head) in heads.iter().enumerate() {
        let own = network::specs(config, head.dims(config))?.into_iter();
        specs.extend(own.map(|spec| TensorSpec::new(format!("{at}/{}", spec.name), &spec.shape)));
    }
    Ok(tensors.fit(NETWORK, &specs, |_| false)?)
}

impl HeadMetadata {
    fn of(head: &TrainedHead) -> Self {
        Self {
            trial: head.trial.clone(),
            width: head.dims.width,
            classes: head.dims.classes,
            target_mean: head.target.mean,
            target_std: head.target.std,
            history: head.history.clone(),
            kept: head.kept.clone(),
        }
    }

    fn dims(&self, config: &HeadConfig) -> Dims {
        Dims {
            slots: config.input.slots(),
            width: self.width,
            classes: self.classes,
        }
    }

    /// The head of these tensors.
    fn with(self, config: &HeadConfig, mut tensors: Weights) -> Result<TrainedHead> {
        let mean = tensors.get(MEAN)?.to_vec1()?;
        let factor = tensors.get(FACTOR)?.to_vec1()?;
        tensors.remove(MEAN);
        tensors.remove(FACTOR);
        Ok(TrainedHead {
            dims: self.dims(config),
            statistics: InputStatistics { mean, factor },
            target: Standardiser {
                mean: self.target_mean,
                std: self.target_std,
            },
            parameters: tensors,
            trial: self.trial,
            history: self.history,
            kept: self.kept,
        })
    }
}

fn refused(name: &str, what: String) -> WeightsError {
    WeightsError::new(name, WeightsErrorKind::Format(what))
}
