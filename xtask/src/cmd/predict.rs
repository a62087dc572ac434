use std::path::PathBuf;

use anyhow::{Context, Result};
use serde_json::json;
use sps_dataset::{DecodeSettings, Frame, read_image};
use tracing::warn;

use crate::model::{Card, Model};

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
    let frames = args.images.iter().map(|path| {
        let frame = read_image(path, &settings)?.frame;
        warn_of_scale(&model.card, path, &frame);
        Ok(frame)
    });
    let estimates = model.predict(&frames.collect::<Result<Vec<_>>>()?)?;
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

/// Texture means something at one scale only: a photograph at another is worth a word.
fn warn_of_scale(card: &Card, path: &std::path::Path, frame: &Frame) {
    let fitted = card.frame_size.into_iter().min().unwrap_or(1).max(1) as f64;
    let ratio = frame.width.min(frame.height) as f64 / fitted;
    if card.resize.is_none() && !(0.5..=2.0).contains(&ratio) {
        warn!(
            "{} is {} x {} pixels; the model was fitted on {} x {} and expects surfaces at that scale",
            path.display(),
            frame.width,
            frame.height,
            card.frame_size[1],
            card.frame_size[0]
        );
    }
}
