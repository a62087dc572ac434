//! Training encoders: images in, an encoder and the record of its training out.

mod events;
mod images;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use sps_models::encoders::Encoder;
use sps_models::training::{Epoch, ImageSource, Losses, Parts, Targets, Trainer, TrainingConfig};
use sps_models::weights::Weights;
use tracing::info;

use crate::checksums;
use crate::files::{create_folder, lock};
use crate::progress::{Progress, ensure_wanted};
pub(crate) use events::EventFile;
pub use images::FrameImages;

const STATE: &str = "state.safetensors";
const ENCODER: &str = "encoder.safetensors";
const EPOCHS: &str = "epochs.json";
const SECONDS: &str = "seconds.json";
const LOCK: &str = "lock";

/// An encoder to train, and everything that its weights then depend on.
pub struct Task<'a> {
    /// What is trained, for the progress line.
    pub name: &'a str,
    /// What training begins with.
    pub start: &'a Encoder,
    /// What is learnt, for each image.
    pub targets: Targets,
    /// Images to train and to validate on.
    pub parts: Parts,
    /// How it is trained.
    pub config: &'a TrainingConfig,
    /// Keys every draw.
    pub seed: u64,
    /// Two tasks with one key have the same images and targets.
    pub key: blake3::Hash,
}

/// A trained encoder, with what each epoch did.
pub struct TrainedEncoder {
    /// With its trained weights.
    pub encoder: Encoder,
    /// Epoch by epoch.
    pub history: Vec<Epoch>,
    /// How long it took, all processes together that had a part in it.
    pub seconds: f64,
    /// Where the record of the training is.
    pub folder: PathBuf,
}

/// Trains, or goes on where a training of the same task was stopped; `folder` holds a folder of
/// each task.
///
/// # Errors
/// An image that cannot be had; a folder that cannot be written to; a state of another training.
pub fn train(task: Task<'_>, images: &dyn ImageSource, folder: &Path) -> Result<TrainedEncoder> {
    let folder = task.folder(folder)?;
    create_folder(&folder)?;
    // Runs share this folder.
    let _lock = lock(&folder.join(LOCK))?;
    if let Some(trained) = finished(&task, &folder)? {
        return Ok(trained);
    }
    let name = task.name.to_owned();
    let seconds = seconds(&folder)?;
    let mut trainer = begin(task, &folder.join(STATE), seconds.is_some())?;
    let mut events = EventFile::create(&folder)?;
    let mut progress = None;
    let mut seconds = seconds.unwrap_or(0.0);
    while !trainer.is_finished() {
        let begun = Instant::now();
        let mut shown = 0;
        trainer.epoch(images, |step| {
            shown += step.images;
            let progress =
                progress.get_or_insert_with(|| Progress::resumed(&name, step.number - 1, step.of));
            let speed = shown as f64 / begun.elapsed().as_secs_f64();
            let loss = step.losses.total();
            progress.say(&format!("loss {loss:.3}, {speed:.0} images/s"));
            progress.advance(1);
            events.step(step);
        })?;
        events.epochs(trainer.history())?;
        seconds += begun.elapsed().as_secs_f64();
        checksums::write(&folder.join(SECONDS), &serde_json::to_vec(&seconds)?)?;
        checksums::write(&folder.join(STATE), &trainer.to_bytes()?)?;
        ensure_wanted()?;
    }
    drop(progress);
    let history = trainer.history().to_vec();
    let encoder = trainer.into_encoder()?;
    let record = serde_json::to_vec_pretty(&history)?;
    checksums::write(&folder.join(EPOCHS), &record)?;
    checksums::write(&folder.join(ENCODER), &encoder.weights().to_bytes()?)?;
    checksums::remove(&folder.join(STATE))?;
    Ok(TrainedEncoder {
        encoder,
        history,
        seconds,
        folder,
    })
}

/// What the task came to where it was trained before; `folder` holds a folder of each task.
pub(crate) fn trained(task: &Task<'_>, folder: &Path) -> Result<Option<TrainedEncoder>> {
    finished(task, &task.folder(folder)?)
}

/// How long a training has taken so far; none where it begins, or begins again.
fn seconds(folder: &Path) -> Result<Option<f64>> {
    if folder.join(ENCODER).exists() {
        return Ok(None);
    }
    let text = checksums::read(&folder.join(SECONDS))?;
    let seconds = text.map(|text| serde_json::from_slice(&text));
    seconds.transpose().context("the seconds of a training")
}

impl Task<'_> {
    /// Its folder in the one of all tasks.
    fn folder(&self, all: &Path) -> Result<PathBuf> {
        Ok(all.join(&self.identity()?[..16]))
    }

    fn identity(&self) -> Result<String> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(env!("SOURCE_HASH").as_bytes());
        hasher.update(&self.start.content_hash());
        hasher.update(self.key.as_bytes());
        hasher.update(&self.seed.to_le_bytes());
        hasher.update(&serde_json::to_vec(self.config)?);
        for part in [&self.parts.training, &self.parts.validation] {
            hasher.update(&(part.len() as u64).to_le_bytes());
            for &image in part {
                hasher.update(&(image as u64).to_le_bytes());
            }
        }
        Ok(hasher.finalize().to_hex().to_string())
    }
}

/// What the same task came to before.
fn finished(task: &Task<'_>, folder: &Path) -> Result<Option<TrainedEncoder>> {
    let path = folder.join(ENCODER);
    if !path.exists() {
        return Ok(None);
    }
    let [weights, history, seconds] =
        [ENCODER, EPOCHS, SECONDS].map(|name| checksums::read(&folder.join(name)));
    let (Some(weights), Some(history), Some(seconds)) = (weights?, history?, seconds?) else {
        return Ok(None);
    };
    let weights = Weights::from_bytes(&path.display().to_string(), &weights)?;
    info!("{}: trained before, {}", task.name, folder.display());
    Ok(Some(TrainedEncoder {
        encoder: Encoder::new(task.start.kind(), weights)?.with_depths(task.start.depths())?,
        history: serde_json::from_slice(&history).context("the record of a training")?,
        seconds: serde_json::from_slice(&seconds).context("the seconds of a training")?,
        folder: folder.to_owned(),
    }))
}

/// At the state in which the task was stopped, if it `goes_on`.
fn begin(task: Task<'_>, state: &Path, goes_on: bool) -> Result<Trainer> {
    let (targets, parts, seed) = (task.targets, task.parts, task.seed);
    let config = task.config.clone();
    let bytes = if goes_on {
        checksums::read(state)?
    } else {
        None
    };
    let Some(bytes) = bytes else {
        return Ok(Trainer::new(task.start, targets, parts, config, seed)?);
    };
    let path = state.display().to_string();
    let trainer = Trainer::resume(&path, &bytes, targets, parts, config, seed)?;
    let epochs = trainer.history().len();
    info!("{}: goes on after epoch {epochs}", task.name);
    Ok(trainer)
}

/// Losses of an encoder that linear layers stand on in words, for people; those that there are.
pub fn in_words(losses: &Losses) -> String {
    let error = losses.values;
    let mut words = vec![format!("squared error {error:.3} of the variance")];
    if losses.classes > 0.0 {
        words.push(format!("cross-entropy {:.3}", losses.classes));
        words.push(format!("{:.1} % of classes right", 100.0 * losses.accuracy));
    }
    if losses.kept > 0.0 {
        words.push(format!("error of kept features {:.3}", losses.kept));
    }
    words.join(", ")
}
