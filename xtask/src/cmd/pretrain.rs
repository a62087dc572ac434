use std::path::PathBuf;

use anyhow::{Context, Result};
use candle_core::Device;
use sps_dataset::FrameIndex;
use sps_models::Readings;
use sps_models::encoders::Encoder;
use sps_models::training::{Classes, Parts, Targets};
use sps_models::weights::Storage;
use sps_simulate::{Material, Simulator};

use crate::config::{Pretraining, Setting};
use crate::files::write_atomically;
use crate::training::{FrameImages, Task, TrainedEncoder, in_words, train};

/// Train an encoder on simulated surfaces to tell material and visible parameters
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
    let simulator = Simulator::new(pretraining.simulated.clone())?;
    let frames = frames(&pretraining);
    let start = Encoder::seeded(pretraining.kind, pretraining.seed, &Device::Cpu)?;
    let task = Task {
        name: "pretraining",
        start: &start,
        targets: targets(&simulator, &frames)?,
        parts: parts(&frames, pretraining.training.validation),
        config: &pretraining.training,
        seed: pretraining.seed,
        key: blake3::hash(format!("{:?} {frames:?}", pretraining.simulated).as_bytes()),
    };
    let images = FrameImages::new(&simulator, frames, None);
    let runs = PathBuf::from("runs").join(&pretraining.name);
    let trained = train(task, &images, &runs)?;
    let note = note(&pretraining, &trained)?;
    let weights = trained.encoder.weights();
    let bytes = weights.to_bytes_as(Storage::F16, Some(("sps-pretraining", &note)))?;
    write_atomically(&args.out, &bytes)?;
    println!(
        "{} ({} KiB)\n{}\nTensorBoard: {}",
        args.out.display(),
        bytes.len() / 1024,
        quality(&trained),
        trained.folder.display()
    );
    Ok(())
}

/// One view of each surface from each range of angles, somewhere in it.
fn frames(pretraining: &Pretraining) -> Vec<FrameIndex> {
    let (views, ranges) = (pretraining.simulated.views, pretraining.views_per_surface);
    let view = |surface: usize, range: usize| {
        let (from, to) = (range * views / ranges, (range + 1) * views / ranges);
        let draw = blake3::hash(format!("{} {surface} {range}", pretraining.seed).as_bytes());
        from + usize::from(draw.as_bytes()[0]) * (to - from) / 256
    };
    let of_surface = |surface| (0..ranges).map(move |range| (surface, range));
    (0..pretraining.simulated.surfaces)
        .flat_map(of_surface)
        .map(|(surface, range)| FrameIndex {
            surface,
            view: view(surface, range),
        })
        .collect()
}

/// The last surfaces are kept for validation: surface `i` is the same whatever their number.
fn parts(frames: &[FrameIndex], validation: f64) -> Parts {
    let surfaces = frames.iter().map(|frame| frame.surface + 1).max();
    let first_kept = (surfaces.unwrap_or(0) as f64 * (1.0 - validation)).round() as usize;
    let (training, validation) =
        (0..frames.len()).partition(|&image| frames[image].surface < first_kept);
    Parts {
        training,
        validation,
    }
}

/// What is seen of each surface: its material, and what its images are rendered from.
const VISIBLE: [&str; 7] = [
    "log-period",
    "log-relief",
    "regularity",
    "log-microrelief",
    "log-microrelief-length",
    "log-roughness",
    "sheen",
];

fn targets(simulator: &Simulator, frames: &[FrameIndex]) -> Result<Targets> {
    let mut rows = Vec::new();
    let mut of_image = Vec::new();
    for frame in frames {
        let material = simulator.material(frame.surface)?;
        let index = Material::ALL.iter().position(|other| *other == material);
        of_image.push(index.context("a material that is not listed")? as u32);
        let seen = simulator.parameters(frame.surface)?;
        let values = [
            seen.period_mm.ln(),
            seen.relief_mm.ln(),
            seen.regularity,
            seen.micro_um.ln(),
            seen.micro_length_mm.ln(),
            seen.alpha.ln(),
            seen.sheen,
        ];
        // What a surface does not have has no logarithm.
        rows.push(values.map(|v| Some(v).filter(|v| v.is_finite())).to_vec());
    }
    Ok(Targets {
        values: Some(Readings::new(VISIBLE.map(str::to_owned).to_vec(), &rows)?),
        classes: Some(Classes {
            of_image,
            count: Material::ALL.len() as u32,
        }),
    })
}

fn quality(trained: &TrainedEncoder) -> String {
    let kept = trained.history.iter().rfind(|epoch| epoch.best);
    match kept.and_then(|epoch| Some((epoch.number, epoch.validation?))) {
        Some((number, losses)) => format!(
            "surfaces kept out, after epoch {number}: {}",
            in_words(&losses)
        ),
        None => "no surfaces were kept out".to_owned(),
    }
}

/// Where the weights come from, for the file's metadata.
fn note(pretraining: &Pretraining, trained: &TrainedEncoder) -> Result<String> {
    let note = serde_json::json!({
        "config": pretraining.resolved,
        "quality": quality(trained),
    });
    Ok(serde_json::to_string(&note)?)
}
