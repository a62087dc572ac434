//! Training encoders: images in, an encoder and the record of its training out.

mod events;
mod images;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use candle_core::Device;
use sps_models::encoders::Encoder;
use sps_models::training::{
    Epoch, ImageSource, Losses, Parts, Step, Targets, Trainer, TrainingConfig,
};
use sps_models::weights::Weights;
use tracing::info;

use crate::files::write_atomically;
use crate::progress::Progress;
use events::EventFile;
pub(crate) use images::FrameImages;

const STATE: &str = "state.safetensors";
const ENCODER: &str = "encoder.safetensors";
const EPOCHS: &str = "epochs.json";
const SECONDS: &str = "seconds.json";

/// An encoder to train, and everything that its weights then depend on.
pub(crate) struct Task<'a> {
    /// What is trained, for the progress line.
    pub name: &'a str,
    pub start: &'a Encoder,
    pub targets: Targets,
    pub parts: Parts,
    pub config: &'a TrainingConfig,
    pub seed: u64,
    /// Two tasks with one key have the same images and targets.
    pub key: blake3::Hash,
}

/// A trained encoder, with what each epoch did.
pub(crate) struct Trained {
    pub encoder: Encoder,
    pub history: Vec<Epoch>,
    /// How long it took, all processes together that had a part in it.
    pub seconds: f64,
    /// Where the record of the training is.
    pub folder: PathBuf,
}

/// Trains, or goes on where a training of the same task was stopped; `folder` holds a folder of
/// each task.
pub(crate) fn train(task: Task<'_>, images: &dyn ImageSource, folder: &Path) -> Result<Trained> {
    let folder = folder.join(&task.identity()?[..16]);
    if let Some(trained) = finished(&task, &folder)? {
        return Ok(trained);
    }
    let name = task.name.to_owned();
    let mut trainer = begin(task, &folder.join(STATE))?;
    let mut events = EventFile::create(&folder)?;
    let mut progress = None;
    let mut seconds = seconds(&folder)?;
    while !trainer.is_finished() {
        let begun = Instant::now();
        let mut shown = 0;
        trainer.epoch(images, |step| {
            shown += step.images;
            let progress =
                progress.get_or_insert_with(|| Progress::resumed(&name, step.number - 1, step.of));
            progress.say(&line(step, shown as f64 / begun.elapsed().as_secs_f64()));
            progress.advance(1);
            events.step(step);
        })?;
        events.epochs(trainer.history())?;
        seconds += begun.elapsed().as_secs_f64();
        write_atomically(&folder.join(SECONDS), &serde_json::to_vec(&seconds)?)?;
        write_atomically(&folder.join(STATE), &trainer.to_bytes()?)?;
    }
    drop(progress);
    let history = trainer.history().to_vec();
    let encoder = trainer.into_encoder()?;
    write_atomically(&folder.join(EPOCHS), &serde_json::to_vec_pretty(&history)?)?;
    write_atomically(&folder.join(ENCODER), &encoder.weights().to_bytes()?)?;
    fs::remove_file(folder.join(STATE)).context("a training state that is done with")?;
    Ok(Trained {
        encoder,
        history,
        seconds,
        folder,
    })
}

/// How long a training has taken so far.
fn seconds(folder: &Path) -> Result<f64> {
    let path = folder.join(SECONDS);
    if !path.exists() {
        return Ok(0.0);
    }
    let text = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_slice(&text).with_context(|| format!("{} is damaged", path.display()))
}

impl Task<'_> {
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
fn finished(task: &Task<'_>, folder: &Path) -> Result<Option<Trained>> {
    let path = folder.join(ENCODER);
    if !path.exists() {
        return Ok(None);
    }
    let weights = Weights::read(&path)?;
    let history = fs::read(folder.join(EPOCHS)).context("the record of a training")?;
    info!("{}: trained before, {}", task.name, folder.display());
    Ok(Some(Trained {
        encoder: Encoder::new(task.start.kind(), weights, &Device::Cpu)?,
        history: serde_json::from_slice(&history).context("the record of a training")?,
        seconds: seconds(folder)?,
        folder: folder.to_owned(),
    }))
}

fn begin(task: Task<'_>, state: &Path) -> Result<Trainer> {
    let Task {
        name,
        start,
        targets,
        parts,
        config,
        seed,
        ..
    } = task;
    let config = config.clone();
    if !state.exists() {
        return Ok(Trainer::new(start, targets, parts, config, seed)?);
    }
    let bytes = fs::read(state).with_context(|| format!("cannot read {}", state.display()))?;
    let path = state.display().to_string();
    let trainer = Trainer::resume(&path, &bytes, targets, parts, config, seed)?;
    info!("{name}: goes on after epoch {}", trainer.history().len());
    Ok(trainer)
}

fn line(step: &Step, images_per_second: f64) -> String {
    format!(
        "loss {:.3}, {images_per_second:.0} images/s",
        step.losses.total()
    )
}

/// Losses in words, for people.
pub(crate) fn in_words(losses: &Losses) -> String {
    format!(
        "squared error {:.3} of the variance, cross-entropy {:.3}, {:.1} % of classes right",
        losses.values,
        losses.classes,
        100.0 * losses.accuracy
    )
}
