//! Trained heads as safetensors: the tensors of head `i` are named `i/<parameter>`, and the
//! metadata hold the configuration and what each head was trained for.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

use candle_core::{Device, Tensor};
use safetensors::{Dtype, SafeTensors, View};
use serde::{Deserialize, Serialize};

use super::config::HeadConfig;
use super::input::InputStatistics;
use super::network::{Dims, Fill, Network, Spec};
use super::plan::Trial;
use super::trained::{DivergedTrial, EpochLosses, KeptEpoch, TrainedHead, TrainedHeads};
use super::{Head, HeadError};
use crate::error::Result;
use crate::labels::standardise::Spread;
use crate::stacked::Parameter;

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
    ///
    /// A parameter that cannot be read as f32.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let metadata = Metadata {
            format: FORMAT,
            config: self.head.config().clone(),
            heads: self.heads.iter().map(HeadMetadata::of).collect(),
            diverged: self.diverged.clone(),
        };
        let metadata = serde_json::to_string(&metadata)
            .map_err(|source| format("trained heads", "metadata", source, "JSON"))?;
        let mut tensors = Vec::new();
        for (at, head) in self.heads.iter().enumerate() {
            let width = head.statistics.mean.len();
            for (name, values) in [
                (MEAN, &head.statistics.mean),
                (FACTOR, &head.statistics.factor),
            ] {
                tensors.push((format!("{at}/{name}"), Values::new(vec![width], values)));
            }
            for (name, tensor) in &head.parameters {
                let values = tensor.flatten_all()?.to_vec1::<f32>()?;
                let values = Values::new(tensor.dims().to_vec(), &values);
                tensors.push((format!("{at}/{name}"), values));
            }
        }
        let metadata = HashMap::from([(KEY.to_owned(), metadata)]);
        let bytes = safetensors::serialize(tensors, Some(metadata))
            .map_err(|source| format("trained heads", "content", source, "safetensors"))?;
        Ok(bytes)
    }

    /// Writes the heads to a file, which is there whole or not at all.
    ///
    /// # Errors
    ///
    /// What the file system says, with the path.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let bytes = self.to_bytes()?;
        let mut partial = path.as_os_str().to_owned();
        partial.push(format!(".{}.partial", std::process::id()));
        let written =
            std::fs::write(&partial, bytes).and_then(|()| std::fs::rename(&partial, path));
        written.map_err(|source| {
            // What is left of it is of no use; that it cannot be removed matters less.
            let _ = std::fs::remove_file(&partial);
            HeadError::File {
                path: path.to_owned(),
                source,
            }
            .into()
        })
    }

    /// Reads a file that [`TrainedHeads::save`] wrote.
    ///
    /// # Errors
    ///
    /// What the file system says, or a file that does not hold trained heads; with the path.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|source| HeadError::File {
            path: path.to_owned(),
            source,
        })?;
        Self::from_bytes(&path.display().to_string(), &bytes)
    }

    /// Reads the content of a file; `name` stands for it in error messages.
    ///
    /// # Errors
    ///
    /// Metadata that are missing, of another format or not valid; a tensor that is missing, of
    /// another shape or type than the configuration asks for, not finite, or not asked for.
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self> {
        let metadata = read_metadata(name, bytes)?;
        let head = Head::new(metadata.config)?;
        let tensors = SafeTensors::deserialize(bytes)
            .map_err(|source| format(name, "content", source, "safetensors"))?;
        let mut reader = Reader {
            name,
            tensors: &tensors,
            head: 0,
            read: BTreeSet::new(),
            parameters: BTreeMap::new(),
        };
        let mut heads = Vec::with_capacity(metadata.heads.len());
        for (at, one) in metadata.heads.into_iter().enumerate() {
            reader.head = at;
            heads.push(reader.head(head.config(), one)?);
        }
        for other in tensors.names() {
            if !reader.read.contains(other) {
                return Err(format(name, other, "a tensor of this name", "none").into());
            }
        }
        Ok(Self {
            head,
            heads,
            diverged: metadata.diverged,
        })
    }
}

fn read_metadata(name: &str, bytes: &[u8]) -> Result<Metadata> {
    let (_, header) = SafeTensors::read_metadata(bytes)
        .map_err(|source| format(name, "content", source, "safetensors"))?;
    let text = header
        .metadata()
        .as_ref()
        .and_then(|metadata| metadata.get(KEY))
        .ok_or_else(|| {
            format(
                name,
                "metadata",
                format_args!("no {KEY:?}"),
                "trained heads",
            )
        })?;
    let metadata: Metadata = serde_json::from_str(text)
        .map_err(|source| format(name, "metadata", source, "a valid configuration"))?;
    if metadata.format != FORMAT {
        return Err(format(name, "format", metadata.format, FORMAT).into());
    }
    Ok(metadata)
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
}

/// Reads and checks the tensors of one head after the other.
struct Reader<'a> {
    name: &'a str,
    tensors: &'a SafeTensors<'a>,
    head: usize,
    read: BTreeSet<String>,
    parameters: BTreeMap<String, Tensor>,
}

impl Reader<'_> {
    fn head(&mut self, config: &HeadConfig, metadata: HeadMetadata) -> Result<TrainedHead> {
        let dims = Dims {
            slots: config.input.slots(),
            width: metadata.width,
            classes: metadata.classes,
        };
        let statistics = InputStatistics {
            mean: self.values(MEAN, &[dims.width])?,
            factor: self.values(FACTOR, &[dims.width])?,
        };
        Network::new(self, config, dims)?;
        Ok(TrainedHead {
            trial: metadata.trial,
            dims,
            statistics,
            target: Spread {
                mean: metadata.target_mean,
                std: metadata.target_std,
            },
            parameters: std::mem::take(&mut self.parameters),
            history: metadata.history,
            kept: metadata.kept,
        })
    }

    fn values(&mut self, parameter: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let key = format!("{}/{parameter}", self.head);
        let expected = format!("f32 of shape {shape:?}");
        let tensor = self
            .tensors
            .tensor(&key)
            .map_err(|_| format(self.name, &key, "no such tensor", &expected))?;
        if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
            let found = format!("{:?} of shape {:?}", tensor.dtype(), tensor.shape());
            return Err(format(self.name, &key, found, &expected).into());
        }
        let values: Vec<f32> = tensor
            .data()
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect();
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            return Err(format(self.name, &key, value, "finite values").into());
        }
        self.read.insert(key);
        Ok(values)
    }
}

impl Fill for Reader<'_> {
    fn fill(&mut self, spec: &Spec<'_>) -> Result<Parameter> {
        let values = self.values(spec.name, spec.shape)?;
        let tensor = Tensor::from_vec(values, spec.shape, &Device::Cpu)?;
        self.parameters.insert(spec.name.to_owned(), tensor.clone());
        Ok(Parameter::constant(tensor))
    }
}

fn format(
    name: &str,
    what: &str,
    found: impl std::fmt::Display,
    expected: impl std::fmt::Display,
) -> HeadError {
    HeadError::Format {
        file: name.to_owned(),
        what: what.to_owned(),
        found: found.to_string(),
        expected: expected.to_string(),
    }
}

/// An f32 tensor on its way into a file.
struct Values {
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Values {
    fn new(shape: Vec<usize>, values: &[f32]) -> Self {
        Self {
            shape,
            bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }
}

impl View for Values {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}
