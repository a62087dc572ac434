use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use sps_dataset::{
    DatasetFolder, FEWEST_PER_MATERIAL, Inspection, MaterialLabels, OTHER, PropertySummary,
    ReadSettings, Source, TactileSettings,
};
use tracing::info;

use crate::config::{DataSpec, Experiment, Setting};
use crate::files::write_atomically;
use crate::progress::Progress;
use crate::report::published::published;
use crate::report::statistics;
use crate::report::table::number;

/// Check a dataset and show its statistics
#[derive(clap::Args)]
#[command(
    after_help = "Its values stand beside those of the published dataset, and are drawn as \
    boxes.svg and materials.svg. Ends with status 1 where a frame is missing or broken.\n\n\
    Examples:\n  \
    cargo xtask inspect fixtures/tiny-dataset\n  \
    cargo xtask inspect --config configs/friction-photos.toml"
)]
pub(crate) struct Args {
    /// The folder of the dataset
    #[arg(required_unless_present = "config")]
    dataset: Option<PathBuf>,
    /// An experiment's TOML file: its dataset, read by its settings
    #[arg(long, value_name = "FILE", conflicts_with = "dataset")]
    config: Option<PathBuf>,
    /// Override a key of the config; VALUE is TOML, or else a text
    #[arg(long = "set", value_name = "KEY=VALUE", requires = "config")]
    settings: Vec<Setting>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// The folder to draw to [default: runs/inspect/ and the dataset's folder name]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let (path, read) = args.read()?;
    let dataset = DatasetFolder::open(&path, &read)?;
    let mut inspection = dataset.inspect(&read.tactile);
    let progress = Progress::new("frames checked", inspection.surfaces * inspection.views);
    let frames = dataset.inspect_frames(|| progress.advance(1));
    drop(progress);
    let broken = frames.broken.len();
    inspection.frames = Some(frames);
    if args.json {
        println!("{}", serde_json::to_string_pretty(&inspection)?);
    } else {
        print(&inspection, &labels(&dataset));
    }
    draw(&dataset, read.tactile, &args.figures(&path))?;
    if broken > 0 {
        bail!("{broken} frames of {} cannot be read", path.display());
    }
    Ok(())
}

impl Args {
    /// The dataset's folder, and how it is read.
    fn read(&self) -> Result<(PathBuf, ReadSettings)> {
        let Some(config) = &self.config else {
            let dataset = self.dataset.clone().unwrap_or_default();
            return Ok((dataset, ReadSettings::default()));
        };
        match Experiment::read(config, &self.settings)?.data {
            DataSpec::Folder { path, read, .. } => Ok((path, *read)),
            DataSpec::Simulated { .. } => bail!(
                "{}: `data.from` is \"simulator\", so there is no folder to inspect; `simulate` writes one",
                config.display()
            ),
        }
    }

    fn figures(&self, dataset: &Path) -> PathBuf {
        self.out.clone().unwrap_or_else(|| {
            let folder = dataset.canonicalize();
            let folder = folder.as_deref().unwrap_or(dataset);
            Path::new("runs/inspect").join(folder.file_name().unwrap_or_default())
        })
    }
}

/// Surfaces per label by the paper's rule, the most frequent first and `other` last.
fn labels(dataset: &DatasetFolder) -> Vec<(String, usize)> {
    let labels = MaterialLabels::of(dataset.surfaces(), FEWEST_PER_MATERIAL);
    let count = |label: usize| labels.labels().iter().filter(|&&l| l == label).count();
    let names = labels.names().iter().cloned();
    let mut counts: Vec<(String, usize)> = names.zip((0..).map(count)).collect();
    counts.sort_by_key(|(name, count)| (name == OTHER, std::cmp::Reverse(*count)));
    counts
}

fn draw(dataset: &DatasetFolder, settings: TactileSettings, folder: &Path) -> Result<()> {
    let surfaces = dataset.surfaces().len();
    let averages = dataset.tactile().averages(&settings, surfaces);
    let values: Vec<(String, Vec<f64>)> = averages
        .properties()
        .iter()
        .map(|&property| {
            let of_surface = |surface| averages.value(surface, property);
            (
                property.to_string(),
                (0..surfaces).filter_map(of_surface).collect(),
            )
        })
        .collect();
    for (name, svg) in [
        ("boxes.svg", statistics::boxes(&values)),
        ("materials.svg", statistics::donut(&labels(dataset))),
    ] {
        write_atomically(&folder.join(name), svg.as_bytes())?;
    }
    info!("boxes.svg and materials.svg are in {}", folder.display());
    Ok(())
}

fn print(inspection: &Inspection, labels: &[(String, usize)]) {
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
    print_labels(inspection.surfaces, labels);
    println!(
        "\n{:<6}{:>9}{:>9}  {:<47}{:>9}{:>8}{:>9}    published",
        "",
        "measured",
        "missing",
        "minimum  quartile    median  quartile   maximum",
        "outside",
        "repeat",
        "between"
    );
    for property in &inspection.properties {
        println!("{}", line(property));
    }
    print_grouped(&inspection.properties);
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

/// The share of the variance between groups above which a split at random flatters most.
const MOSTLY_BETWEEN: f64 = 0.5;

fn print_grouped(properties: &[PropertySummary]) {
    let grouped = properties
        .iter()
        .filter(|property| property.between_groups > Some(MOSTLY_BETWEEN));
    let codes: Vec<String> = grouped.map(|p| p.property.to_string()).collect();
    if !codes.is_empty() {
        println!(
            "\nmore than half of the variance of {} lies between groups (column `between`): a \
             split `by = \"surface\"` would measure recognition of known groups",
            codes.join(", ")
        );
    }
}

fn print_labels(surfaces: usize, labels: &[(String, usize)]) {
    println!(
        "\nlabels, fewer than {FEWEST_PER_MATERIAL} of a material being `{OTHER}`\n  \
         {:<24}{:>6}{:>9}{:>11}",
        "", "", "share", "published"
    );
    for (name, count) in labels {
        let share = 100.0 * *count as f64 / surfaces.max(1) as f64;
        let printed = published().materials.get(name);
        let printed = printed.map_or("–".to_owned(), |share| format!("{:.1} %", 100.0 * share));
        println!("  {name:<24}{count:>6}{share:>7.1} %{printed:>11}");
    }
}

fn line(property: &PropertySummary) -> String {
    let shown = |q: Option<[f64; 5]>| {
        q.map_or("–".to_owned(), |q| {
            format!(
                "{:>7.1}{:>10.1}{:>10.1}{:>10.1}{:>10.1}",
                q[0], q[1], q[2], q[3], q[4]
            )
        })
    };
    let quantiles = shown(property.quantiles);
    let code = property.property.to_string();
    let printed = shown(published().quantiles.get(&code).copied());
    let outside = property.out_of_range.below + property.out_of_range.above;
    let repeat = property
        .repeat_std
        .map_or("–".to_owned(), |std| format!("{std:.2}"));
    let between = number(property.between_groups, 2);
    format!(
        "{code:<6}{:>9}{:>9}  {quantiles:>47}{outside:>9}{repeat:>8}{between:>9}  {printed}",
        property.measured, property.missing_cells
    )
}
