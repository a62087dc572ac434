//! A model in a folder: everything that it takes to predict.
//!
//! `estimator.json` says what there is; it is written last and holds the checksums of the other files,
//! so that a folder without it, or with one of them changed, holds no model. A file whose name is taken
//! by an earlier model's is written under one that begins with its checksum, so that the earlier model
//! is whole until `estimator.json` is replaced.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Component, Path};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use sps_base::files::write_file;
use sps_metrics::Level;
use sps_models::encoders::{Block, Depths, Encoder, Precision};
use sps_models::fitted_from_bytes;
use sps_models::weights::Weights;
use sps_onnx::{OnnxEncoder, Settings as OnnxSettings};

use crate::embedder::{Embedder, Network};
use crate::error::{Error, Result};
use crate::estimator::{About, Estimator};
use crate::fitted::{Fitted, FittedOn, Interval, Measure, Stage};
use crate::novelty::Familiar;
use crate::precomputed::Precomputed;

/// Of the files that are written now.
const FORMAT: u64 = 2;
const CARD: &str = "estimator.json";
const ENCODER: &str = "encoder.safetensors";
const ONNX: &str = "encoder.onnx";
const FAMILIAR: &str = "familiar.safetensors";
/// What of a checksum a file's name begins with where another has its name.
const PREFIX: usize = 16;
/// What an artefact's text may have at most.
const MOST_TEXT: u64 = 64 << 20;

/// `estimator.json`.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Card {
    format: u64,
    /// The crate and its version.
    written_by: String,
    about: About,
    encoder: EncoderCard,
    level: Level,
    joint: Interval,
    fitted_on: FittedOn,
    measures: Vec<Measure>,
    stages: Vec<Stage<ModelsCard>>,
    /// Why there is no file of what is familiar.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    no_familiar: Option<String>,
    /// blake3 of the other files, by name.
    checksums: BTreeMap<String, String>,
}

/// What is read first: the text of another format has other keys.
#[derive(Deserialize)]
struct Format {
    format: u64,
}

/// Of a card that is replaced.
#[derive(Deserialize)]
struct Earlier {
    checksums: BTreeMap<String, String>,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct EncoderCard {
    name: String,
    #[serde(default)]
    depths: Depths,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    precision: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    resize: Option<usize>,
    /// How the network of an ONNX file is used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    onnx: Option<OnnxSettings>,
    /// Name and width of each block of embeddings that are computed elsewhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    precomputed: Option<Vec<(String, usize)>>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct ModelsCard {
    kind: String,
    file: String,
}

impl Estimator {
    /// Writes the model into a folder, which is created where it is not there. A model that the folder
    /// holds is replaced in one step: killed before that, the earlier one is still whole.
    ///
    /// One process may save into a folder at a time.
    ///
    /// # Errors
    /// A file that cannot be written, numbers that are not finite.
    pub fn save(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).map_err(Error::file(folder))?;
        let mut files = Files {
            folder,
            written: BTreeSet::new(),
            checksums: BTreeMap::new(),
        };
        let encoder = files.encoder(&self.embedder)?;
        if let Ok(familiar) = &self.fitted.familiar {
            files.write(FAMILIAR, &familiar.to_bytes()?)?;
        }
        let stages = self.fitted.stages.iter().map(|stage| {
            stage.with(|_, file, models| {
                files.write(&file, &models.to_bytes()?)?;
                let kind = models.kind().to_owned();
                Ok(ModelsCard { kind, file })
            })
        });
        let stages = stages.collect::<Result<_>>()?;
        let path = folder.join(CARD);
        let earlier = fs::read(&path).ok();
        let earlier = earlier.and_then(|text| serde_json::from_slice(&text).ok());
        let mut names = earlier.map_or_else(BTreeMap::new, |Earlier { checksums }| checksums);
        names.extend(files.checksums.clone());
        let card = Card {
            format: FORMAT,
            written_by: concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")).to_owned(),
            about: self.about.clone(),
            encoder,
            level: self.fitted.level,
            joint: self.fitted.joint.clone(),
            fitted_on: self.fitted.on,
            measures: self.fitted.measures.clone(),
            stages,
            no_familiar: self.fitted.no_familiar().map(str::to_owned),
            checksums: files.checksums,
        };
        let text = serde_json::to_vec_pretty(&card);
        let text = text.map_err(|error| Error::artefact(&path, error))?;
        write_file(&path, &text).map_err(Error::file(&path))?;
        remove_others(folder, &names, &files.written).map_err(Error::file(folder))
    }

    /// Whether a folder holds a model, whole or not.
    pub fn is_in(folder: &Path) -> bool {
        folder.join(CARD).exists()
    }

    /// Reads a model that [`Estimator::save`] wrote and checks that its files belong together.
    ///
    /// # Errors
    /// A file that cannot be read, is damaged or was written with another; another format.
    pub fn load(folder: &Path) -> Result<Self> {
        let path = folder.join(CARD);
        let text = read(&path)?;
        let refused = |error| Error::artefact(&path, error);
        let Format { format } = serde_json::from_slice(&text).map_err(refused)?;
        if format != FORMAT {
            let problem = format!("format {format}, expected {FORMAT}: another version wrote it");
            return Err(Error::artefact(&path, problem));
        }
        let card: Card = serde_json::from_slice(&text).map_err(refused)?;
        card.check()
            .map_err(|problem| Error::artefact(&path, problem))?;
        let network = card.encoder.network(folder, &card.checksums)?;
        let steps: Vec<usize> = card.stages.iter().map(|stage| stage.views).collect();
        let familiar = if card.checksums.contains_key(FAMILIAR) {
            let bytes = read_checked(folder, FAMILIAR, &card.checksums)?;
            let refused = |problem| Error::artefact(&folder.join(FAMILIAR), problem);
            let familiar = Familiar::from_bytes(&bytes).map_err(refused)?;
            if !familiar.answers(&steps, network.width()) {
                let problem = "other numbers of views, or another width";
                return Err(refused(problem.to_owned()));
            }
            Ok(familiar)
        } else {
            Err(card.no_familiar.unwrap_or_default())
        };
        let stages = card.stages.iter().map(|stage| {
            stage.with(|group, _, ModelsCard { kind, file }| {
                let bytes = read_checked(folder, file, &card.checksums)?;
                let models = fitted_from_bytes(kind, file, &bytes)?;
                let (found, expected) = (models.trials().len(), group.properties.len());
                if found == expected {
                    return Ok(models);
                }
                let problem = format!("{found} models, expected {expected}");
                Err(Error::artefact(&folder.join(file), problem))
            })
        });
        let fitted = Fitted {
            stages: stages.collect::<Result<_>>()?,
            familiar,
            level: card.level,
            joint: card.joint,
            on: card.fitted_on,
            width: network.width(),
            measures: card.measures,
        };
        let embedder = Embedder::new(network, card.encoder.resize)?;
        Self::new(embedder, fitted, card.about)
    }
}

impl Card {
    /// That its numbers are such as a fit gives; a reason where they are not.
    fn check(&self) -> Result<(), String> {
        if self.measures.is_empty() || self.stages.is_empty() {
            return Err("no property, expected at least one".to_owned());
        }
        let positive = |value: f64| value.is_finite() && value >= 0.0;
        if matches!(self.joint, Interval::Errors(times) if !positive(times)) {
            return Err("all properties at once: expected a finite width".to_owned());
        }
        for measure in &self.measures {
            let ends = measure.lowest.zip(measure.highest);
            let bounded = ends.is_none_or(|(lowest, highest)| lowest <= highest);
            let one = match measure.interval {
                Interval::Errors(times) => Some(times),
                Interval::None(_) => None,
            };
            let mut times = one.iter().chain(measure.several.iter().flatten());
            let widths = times.all(|times| positive(*times));
            if !(bounded && widths && positive(measure.deviation)) {
                let expected = "expected a range in order, and finite widths";
                return Err(format!("{}: {expected}", measure.property));
            }
        }
        let mut before = 0;
        for stage in &self.stages {
            let views = stage.views;
            if views <= before {
                let expected = "expected more each time";
                return Err(format!("{views} views after {before}, {expected}"));
            }
            before = views;
            let mut places: Vec<usize> = Vec::new();
            for group in &stage.groups {
                places.extend(&group.properties);
                let slots = group.slots.iter().all(|slot| *slot < views) && !group.slots.is_empty();
                let least = group.least_errors.iter().all(|least| positive(*least));
                if !slots || !least || group.least_errors.len() != group.properties.len() {
                    let expected = "expected views below that, and an error each";
                    return Err(format!("{views} views: {expected}"));
                }
            }
            places.sort_unstable();
            if !places.iter().copied().eq(0..self.measures.len()) {
                return Err(format!("{views} views: expected each property once"));
            }
        }
        Ok(())
    }
}

impl EncoderCard {
    fn network(&self, folder: &Path, checksums: &BTreeMap<String, String>) -> Result<Network> {
        if let Some(settings) = &self.onnx {
            let bytes = read_checked(folder, ONNX, checksums)?;
            let encoder = OnnxEncoder::new(&self.name, bytes, settings.clone())?;
            return Ok(Network::Onnx(encoder));
        }
        if let Some(blocks) = &self.precomputed {
            let blocks = blocks.iter().cloned();
            let blocks = blocks.map(|(name, width)| Block { name, width }).collect();
            let rows = Precomputed::new(blocks, Vec::new(), Vec::new())?;
            return Ok(Network::Precomputed(Arc::new(rows)));
        }
        let weights = read_checked(folder, ENCODER, checksums)?;
        let weights = Weights::from_bytes(ENCODER, &weights).map_err(sps_models::Error::from)?;
        let encoder = Encoder::new(self.name.parse()?, weights)?;
        let precision: Precision = self.precision.parse().map_err(sps_models::Error::from)?;
        let encoder = encoder.with_precision(precision)?;
        Ok(Network::Images(encoder.with_depths(&self.depths)?))
    }
}

struct Files<'a> {
    folder: &'a Path,
    written: BTreeSet<String>,
    checksums: BTreeMap<String, String>,
}

impl Files<'_> {
    fn write(&mut self, name: &str, bytes: &[u8]) -> Result<()> {
        let hash = blake3::hash(bytes).to_hex().to_string();
        let taken = self.folder.join(name).exists();
        let renamed = renamed(name, &hash).filter(|_| taken);
        let file = renamed.unwrap_or_else(|| name.to_owned());
        let path = self.folder.join(&file);
        write_file(&path, bytes).map_err(Error::file(&path))?;
        self.written.insert(file);
        self.checksums.insert(name.to_owned(), hash);
        Ok(())
    }

    fn encoder(&mut self, embedder: &Embedder) -> Result<EncoderCard> {
        let network = embedder.network();
        let mut card = EncoderCard {
            name: network.name().to_owned(),
            resize: embedder.resize(),
            ..EncoderCard::default()
        };
        match network {
            Network::Images(encoder) | Network::Sequences(encoder, _) => {
                let weights = encoder.weights().to_bytes();
                self.write(ENCODER, &weights.map_err(sps_models::Error::from)?)?;
                card.depths = encoder.depths().clone();
                card.precision = encoder.precision().to_string();
            }
            Network::Onnx(encoder) => {
                self.write(ONNX, encoder.bytes())?;
                card.onnx = Some(encoder.settings().clone());
            }
            Network::Precomputed(rows) => {
                let blocks = rows.blocks().iter();
                let blocks = blocks.map(|block| (block.name.clone(), block.width));
                card.precomputed = Some(blocks.collect());
            }
        }
        Ok(card)
    }
}

/// The file `name` in a folder where another has that name; `None` where `checksum` is none.
fn renamed(name: &str, checksum: &str) -> Option<String> {
    let prefix = checksum.get(..PREFIX)?;
    let hex = prefix.bytes().all(|byte| byte.is_ascii_hexdigit());
    hex.then(|| format!("{prefix}-{name}"))
}

/// Removes what has one of `names`, also behind a checksum, and was not `written`.
fn remove_others(
    folder: &Path,
    names: &BTreeMap<String, String>,
    written: &BTreeSet<String>,
) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let file = entry.file_name();
        let Some(file) = file.to_str().filter(|file| !written.contains(*file)) else {
            continue;
        };
        let behind = file.get(PREFIX..).and_then(|rest| rest.strip_prefix('-'));
        if names.contains_key(file) || behind.is_some_and(|name| names.contains_key(name)) {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

fn read(path: &Path) -> Result<Vec<u8>> {
    let length = fs::metadata(path).map_err(Error::file(path))?.len();
    if length > MOST_TEXT {
        let problem = format!("{length} bytes, expected at most {MOST_TEXT}");
        return Err(Error::artefact(path, problem));
    }
    fs::read(path).map_err(Error::file(path))
}

fn read_checked(
    folder: &Path,
    name: &str,
    checksums: &BTreeMap<String, String>,
) -> Result<Vec<u8>> {
    let path = folder.join(name);
    let components = Path::new(name).components();
    if !components.eq([Component::Normal(name.as_ref())]) {
        let problem = "expected a file of the folder itself";
        return Err(Error::artefact(&path, problem));
    }
    let checksum = checksums.get(name);
    let file = checksum.and_then(|sum| renamed(name, sum));
    let with_prefix = file.map(|file| folder.join(file));
    let path = with_prefix.filter(|path| path.exists()).unwrap_or(path);
    let bytes = fs::read(&path).map_err(Error::file(&path))?;
    let found = blake3::hash(&bytes).to_hex();
    if checksum.is_some_and(|sum| *sum == *found) {
        return Ok(bytes);
    }
    let problem = "not the file that the model was written with";
    Err(Error::artefact(&path, problem))
}
