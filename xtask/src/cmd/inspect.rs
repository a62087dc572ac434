use std::path::PathBuf;

use anyhow::{Result, bail};
use sps_dataset::{DatasetFolder, Inspection, PropertySummary, ReadSettings, TactileSettings};

use crate::progress::Progress;

/// Check a dataset and show its statistics
#[derive(clap::Args)]
#[command(
    after_help = "Ends with status 1 where a frame is missing or broken.\n\nExample:\n  \
    cargo xtask inspect fixtures/tiny-dataset"
)]
pub(crate) struct Args {
    /// The folder of the dataset
    dataset: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let dataset = DatasetFolder::open(&args.dataset, &ReadSettings::default())?;
    let mut inspection = dataset.inspect(&TactileSettings::default());
    let progress = Progress::new("frames checked", inspection.surfaces * inspection.views);
    let frames = dataset.inspect_frames(|| progress.advance(1));
    drop(progress);
    let broken = frames.broken.len();
    inspection.frames = Some(frames);
    if args.json {
        println!("{}", serde_json::to_string_pretty(&inspection)?);
    } else {
        print(&inspection);
    }
    if broken > 0 {
        bail!(
            "{broken} frames of {} cannot be read",
            args.dataset.display()
        );
    }
    Ok(())
}

fn print(inspection: &Inspection) {
    println!(
        "{}: {} surfaces in {} groups, {} views each, {} readings",
        inspection.name,
        inspection.surfaces,
        inspection.groups,
        inspection.views,
        inspection.readings
    );
    println!("\nmaterials");
    for (name, count) in &inspection.materials {
        println!("  {name:<24}{count:>6}");
    }
    println!(
        "\n{:<6}{:>9}{:>9}  {:>47}{:>9}{:>8}",
        "",
        "measured",
        "missing",
        "minimum  quartile    median  quartile   maximum",
        "outside",
        "repeat"
    );
    for property in &inspection.properties {
        println!("{}", line(property));
    }
    if !inspection.untouched.is_empty() {
        println!("\nwithout a reading: {}", inspection.untouched.join(", "));
    }
    let Some(frames) = &inspection.frames else {
        return;
    };
    println!("\nframes");
    for (width, height, count) in &frames.sizes {
        println!("  {width} x {height}: {count}");
    }
    for frame in &frames.broken {
        println!("  broken: {}", frame.error);
    }
    for folder in &frames.unknown_folders {
        println!("  no surface is called `{folder}`");
    }
}

fn line(property: &PropertySummary) -> String {
    let quantiles = property.quantiles.map_or_else(
        || format!("{:>47}", "–"),
        |q| {
            format!(
                "{:>7.1}{:>10.1}{:>10.1}{:>10.1}{:>10.1}",
                q[0], q[1], q[2], q[3], q[4]
            )
        },
    );
    let outside = property.out_of_range.below + property.out_of_range.above;
    let repeat = property
        .repeat_std
        .map_or("–".to_owned(), |std| format!("{std:.2}"));
    format!(
        "{:<6}{:>9}{:>9}  {quantiles}{outside:>9}{repeat:>8}",
        property.property.to_string(),
        property.measured,
        property.missing_cells
    )
}
