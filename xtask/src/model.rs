//! A fitted model in a folder: everything that `predict` needs.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use candle_core::{Device, Tensor};
use serde::{Deserialize, Serialize};
use sps_dataset::{Frame, Property};
use sps_models::Embeddings;
use sps_models::encoders::{Encoder, EncoderKind};
use sps_models::heads::TrainedHeads;
use sps_models::kernel_ridge::TrainedKernelRidges;
use sps_models::ridge::TrainedRidges;
use sps_models::weights::Weights;

use crate::embeddings::Embedder;
use crate::encoder::Loaded;
use crate::files::{read_text, write_atomically};
use crate::memory;
use crate::run::Fitted;

const FORMAT: u32 = 1;
const CARD: &str = "model.json";
const ENCODER: &str = "encoder.safetensors";
const HEADS: &str = "heads.safetensors";
const RIDGES: &str = "ridges.json";
const KERNEL_RIDGES: &str = "kernel-ridges.safetensors";

/// What the model is: `model.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Card {
    pub format: u32,
    /// The config it was fitted by, and the method of that config.
    pub experiment: String,
    pub method: String,
    /// What it was fitted on, in words.
    pub data: String,
    pub encoder: String,
    /// What the encoder computes in; f32 where nothing is said.
    #[serde(default)]
    pub precision: Option<String>,
    pub resize: Option<usize>,
    /// Height and width of the frames it was fitted on.
    pub frame_size: [usize; 2],
    /// Share of surfaces that an interval holds.
    pub level: f64,
    /// Half the width of the interval of each property, in its measured units.
    pub radius: BTreeMap<String, f64>,
    /// Why a property has no interval.
    #[serde(default)]
    pub no_interval: BTreeMap<String, String>,
    /// blake3 of the other files, by name.
    pub checksums: BTreeMap<String, String>,
}

/// A model, ready to predict.
pub(crate) struct Model {
    pub card: Card,
    embedder: Embedder,
    fitted: Fitted,
}

/// An estimate with its interval, in the property's measured units.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Estimate {
    pub property: String,
    pub name: String,
    pub value: f64,
    /// The interval; `None` where there is none, and the model's card says why.
    pub low: Option<f64>,
    pub high: Option<f64>,
}

/// Writes a model; `model.json` comes last, so that a folder without it holds no model.
pub(crate) fn save(
    folder: &Path,
    mut card: Card,
    encoder: &Encoder,
    fitted: &Fitted,
) -> Result<()> {
    let (name, bytes) = match fitted {
        Fitted::Heads(heads) => (HEADS, heads.to_bytes()?),
        Fitted::Ridges(ridges) => (RIDGES, ridges.to_bytes()?),
        Fitted::KernelRidges(ridges) => (KERNEL_RIDGES, ridges.to_bytes()?),
        Fitted::Other(_) => {
            bail!("a model of this kind is not kept: ridge, kernel-ridge and head are")
        }
    };
    card.format = FORMAT;
    for (name, bytes) in [(name, bytes), (ENCODER, encoder.weights().to_bytes()?)] {
        let hash = blake3::hash(&bytes).to_hex().to_string();
        write_atomically(&folder.join(name), &bytes)?;
        card.checksums.insert(name.to_owned(), hash);
    }
    let text = serde_json::to_string_pretty(&card)?;
    write_atomically(&folder.join(CARD), text.as_bytes())
}

impl Model {
    /// Reads a model and checks that its files belong together.
    pub(crate) fn load(folder: &Path) -> Result<Self> {
        let path = folder.join(CARD);
        let card: Card = serde_json::from_str(&read_text(&path)?)
            .with_context(|| format!("{} is no model of this version", path.display()))?;
        let encoder = read_checked(folder, ENCODER, &card)?;
        let kind: EncoderKind = card.encoder.parse()?;
        let weights = Weights::from_bytes(ENCODER, &encoder)?;
        let encoder = Encoder::new(kind, weights, &Device::Cpu)?;
        let precision = card.precision.as_deref().map(str::parse).transpose()?;
        let encoder = encoder.with_precision(precision.unwrap_or_default())?;
        let fitted = if card.checksums.contains_key(HEADS) {
            let bytes = read_checked(folder, HEADS, &card)?;
            Fitted::Heads(Box::new(TrainedHeads::from_bytes(HEADS, &bytes)?))
        } else if card.checksums.contains_key(KERNEL_RIDGES) {
            let bytes = read_checked(folder, KERNEL_RIDGES, &card)?;
            Fitted::KernelRidges(TrainedKernelRidges::from_bytes(&bytes)?)
        } else {
            Fitted::Ridges(TrainedRidges::from_bytes(&read_checked(
                folder, RIDGES, &card,
            )?)?)
        };
        Ok(Self {
            embedder: Embedder::new(Loaded::Images(encoder), card.resize)?,
            card,
            fitted,
        })
    }

    /// The embedding of a photograph.
    pub(crate) fn embed(&self, photograph: &Frame) -> Result<Vec<f32>> {
        self.embedder.embed(std::slice::from_ref(photograph))
    }

    /// Seconds and bytes that it takes to embed the photograph, told from a small one: both grow
    /// with the pixels.
    pub(crate) fn expected_cost(&self, photograph: &Frame) -> Result<(f64, f64)> {
        const SIDE: usize = 256;
        let small = Frame {
            width: SIDE,
            height: SIDE,
            data: vec![0.5; 3 * SIDE * SIDE],
        };
        let times = photograph.data.len() as f64 / small.data.len() as f64;
        let start = Instant::now();
        let (embedded, bytes) = memory::peak(|| self.embed(&small));
        embedded?;
        let bytes = bytes + size_of_val(&small.data[..]);
        Ok((times * start.elapsed().as_secs_f64(), times * bytes as f64))
    }

    /// Estimates every property of one surface from the embeddings of photographs of it, one after
    /// the other; the mean over the photographs where there are several.
    pub(crate) fn predict(&self, values: Vec<f32>) -> Result<Vec<Estimate>> {
        let photographs = values.len() / self.embedder.width();
        let shape = (photographs, 1, self.embedder.width());
        let embeddings = Embeddings::new(&Tensor::from_vec(values, shape, &Device::Cpu)?)?;
        let estimates = self.fitted.models().predict(&embeddings)?;
        let of_property = estimates.iter().map(|estimate| {
            let radius = self.card.radius.get(&estimate.property);
            let value = estimate.values.iter().sum::<f64>() / photographs as f64;
            let property: Property = estimate.property.parse()?;
            Ok(Estimate {
                property: estimate.property.clone(),
                name: property.name().to_owned(),
                value,
                low: radius.map(|radius| value - radius),
                high: radius.map(|radius| value + radius),
            })
        });
        of_property.collect()
    }
}

fn read_checked(folder: &Path, name: &str, card: &Card) -> Result<Vec<u8>> {
    let path = folder.join(name);
    let bytes = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let found = blake3::hash(&bytes).to_hex().to_string();
    if card.checksums.get(name) != Some(&found) {
        bail!(
            "{} is not the file that {CARD} was written with",
            path.display()
        );
    }
    Ok(bytes)
}
