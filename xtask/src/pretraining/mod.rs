//! `pretrain`: an encoder is trained on simulated surfaces, while its features of other images stay as they are.

mod config;
mod world;

use std::path::PathBuf;

use anyhow::Result;
use sps_experiment::config::Setting;
use sps_experiment::files::write_atomically;
use sps_experiment::training::{FrameImages, Task, TrainedEncoder, in_words, train};
use sps_models::encoders::Encoder;
use sps_models::training::{Image, Kept, Targets};
use sps_models::weights::{Storage, Weights};
use tracing::info;

use config::Pretraining;
use world::World;

/// Train an encoder on simulated surfaces, while its features of other images stay as they are
#[derive(clap::Args)]
#[command(
    after_help = "The encoder never sees a tactile value. Stopped at any moment, it goes on after \
    the last whole epoch.\n\nExample:\n  \
    cargo xtask pretrain configs/pretrain.toml --set simulated.surfaces=100 \
    --set training.epochs=2 --out runs/pretrain/quick.safetensors"
)]
pub(crate) struct Args {
    /// The pretraining's TOML file
    config: PathBuf,
    /// Override a key of the config; VALUE is TOML, or else a text
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<Setting>,
    /// The weights file to write, half precision
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let pretraining = Pretraining::read(&args.config, &args.settings)?;
    let world = World::new(&pretraining)?;
    let start = start(&pretraining)?;
    let training = pretraining
        .training
        .clone()
        .beginning(pretraining.start.is_none());
    let runs = PathBuf::from("runs").join(&pretraining.name);
    let images = FrameImages::new(world.len(), |image| {
        let frame = world.frame(image)?;
        Ok(Image::new(frame.height, frame.width, frame.data)?)
    });
    let weight = pretraining.kept.weight;
    let others = world.others();
    let kept = (!others.is_empty()).then(|| Kept::new(start.clone(), others, &images, weight));
    let task = Task {
        name: "pretraining",
        start: &start,
        targets: Targets {
            values: Some(world.visible()?),
            classes: Some(world.classes()?),
            kept: kept.transpose()?,
            ..Targets::default()
        },
        parts: world.parts(pretraining.training.validation),
        config: &training,
        seed: pretraining.seed,
        key: blake3::hash(format!("{} {weight} {}", world.key(), sources()).as_bytes()),
    };
    let trained = train(task, &images, &runs)?;
    let quality = quality(&pretraining, &trained);
    let note = serde_json::json!({ "config": pretraining.resolved, "quality": quality });
    let weights = mixed(&start, &trained.encoder, pretraining.trained_share)?;
    let bytes = weights.to_bytes_as(Storage::F16, Some(("sps-pretraining", &note.to_string())))?;
    write_atomically(&args.out, &bytes)?;
    println!("{} ({} KiB)", args.out.display(), bytes.len() / 1024);
    println!("{quality}");
    println!("TensorBoard: {}", trained.folder.display());
    Ok(())
}

/// The encoder that training begins with.
fn start(pretraining: &Pretraining) -> Result<Encoder> {
    let (kind, seed) = (pretraining.kind, pretraining.seed);
    let Some(path) = &pretraining.start else {
        return Ok(Encoder::seeded(kind, seed)?.with_depths(&pretraining.depths)?);
    };
    let weights = Weights::read(path)?;
    let (encoder, drawn) = Encoder::warm_started(kind, weights, seed)?;
    let (path, all) = (path.display(), kind.specs().len());
    let taken = all - drawn.len();
    info!("started from {path}: {taken} of {all} tensors");
    Ok(encoder.with_depths(&pretraining.depths)?)
}

/// The trained weights, and the rest of the start.
fn mixed(start: &Encoder, trained: &Encoder, share: f64) -> Result<Weights> {
    let trained = trained.weights();
    if share == 1.0 {
        return Ok(trained.clone());
    }
    let tensors = trained.iter().map(|(name, tensor)| {
        let first = start.weights().get(name)?;
        let mixed = ((first * (1.0 - share))? + (tensor * share)?)?;
        Ok((name.to_owned(), mixed))
    });
    let tensors: Vec<_> = tensors.collect::<Result<_>>()?;
    Ok(Weights::from_tensors("the mixed weights", tensors)?)
}

fn quality(pretraining: &Pretraining, trained: &TrainedEncoder) -> String {
    let kept = trained.history.iter().rfind(|epoch| epoch.best);
    let Some((number, losses)) = kept.and_then(|epoch| Some((epoch.number, epoch.validation?)))
    else {
        return "no surfaces were kept out".to_owned();
    };
    let average = ", before the average with the start";
    let share = pretraining.trained_share;
    let mixed = if share < 1.0 { average } else { "" };
    let losses = in_words(&losses);
    format!("surfaces kept out, after epoch {number}{mixed}: {losses}")
}

/// The hash of the sources that decide what a pretraining comes to: those of a trial, and these.
fn sources() -> String {
    let mut hasher = blake3::Hasher::new();
    for source in [
        sps_experiment::SOURCE_HASH,
        include_str!("mod.rs"),
        include_str!("world.rs"),
    ] {
        hasher.update(blake3::hash(source.as_bytes()).as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}
