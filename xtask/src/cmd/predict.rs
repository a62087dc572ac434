use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde_json::json;
use sps_dataset::{DecodeSettings, Frame};
use tracing::warn;

use crate::embeddings::read_prepared;
use crate::model::Model;

/// Estimate the tactile properties of one surface from photographs of it
#[derive(clap::Args)]
#[command(
    after_help = "Several photographs are taken to show one surface; the estimate is their \
    mean.\n\nExample:\n  cargo xtask predict --model models/friction photograph.jpg"
)]
pub(crate) struct Args {
    /// A folder that `train` wrote
    #[arg(long, value_name = "MODEL_DIR")]
    model: PathBuf,
    /// Bring the shorter side to so many pixels, as many as show the same of a surface in the frames
    /// that the model was fitted on; by default photographs keep their size, unless the model says so
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u64).range(1..))]
    resize: Option<u64>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// PNG, JPEG or EXR
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let model =
        Model::load(&args.model).with_context(|| format!("model {}", args.model.display()))?;
    let settings = DecodeSettings::default();
    if let (Some(own), Some(_)) = (model.card.resize, args.resize) {
        bail!(
            "--resize: the model itself brings the shorter side of every photograph to {own} pixels"
        );
    }
    let resize = args.resize.map(|pixels| pixels as usize);
    let resize = model.card.resize.or(resize);
    let mut embeddings = Vec::new();
    for path in &args.images {
        let frame = read_prepared(path, &settings, resize)?;
        if model.card.resize.is_none() {
            warn_of_scale(&model, path, &frame)?;
        }
        embeddings.extend(model.embed(&frame)?);
    }
    let estimates = model.predict(embeddings)?;
    let level = model.card.level;
    if args.json {
        let answer = json!({
            "images": args.images,
            "level": level,
            "estimates": estimates,
            "no_interval": model.card.no_interval,
        });
        println!("{}", serde_json::to_string_pretty(&answer)?);
        return Ok(());
    }
    println!(
        "{:<4}  {:<26} {:>7}   {:.0} % interval",
        "",
        "property",
        "value",
        100.0 * level
    );
    for e in estimates {
        let interval = match e.low.zip(e.high) {
            Some((low, high)) => format!("{low:.1} to {high:.1}"),
            None => "none".to_owned(),
        };
        println!(
            "{:<4}  {:<26} {:>7.1}   {interval}",
            e.property, e.name, e.value
        );
    }
    for (property, reason) in &model.card.no_interval {
        println!("{property}: no interval, {reason}");
    }
    Ok(())
}

/// Texture means something at one scale only: a photograph at another is worth a word, and what it
/// costs if it is large.
fn warn_of_scale(model: &Model, path: &Path, frame: &Frame) -> Result<()> {
    let [height, width] = model.card.frame_size;
    let shorter = width.min(height);
    let ratio = frame.width.min(frame.height) as f64 / shorter.max(1) as f64;
    let cost = match ratio {
        0.5..=2.0 => return Ok(()),
        ..0.5 => String::new(),
        _ => {
            let (seconds, bytes) = model.expected_cost(frame)?;
            format!(
                " Now it takes about {seconds:.1} s and {:.1} GB.",
                bytes / 1e9
            )
        }
    };
    warn!(
        "{} is {} x {} pixels; the model was fitted on {width} x {height} and expects surfaces at \
         that scale: `--resize {shorter}` where it shows as much of a surface as those did.{cost}",
        path.display(),
        frame.width,
        frame.height,
    );
    Ok(())
}
