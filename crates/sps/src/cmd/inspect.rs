use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use sps_dataset::{
    DatasetFolder, FEWEST_PER_MATERIAL, Inspection, MaterialLabels, OTHER, PropertySummary,
    ReadSettings, Source, TactileSettings,
};
use sps_experiment::config::{DataSpec, Experiment, Setting};
use sps_experiment::files::write_atomically;
use sps_experiment::progress::Progress;
use sps_experiment::text::{aligned, decimals, number};
use sps_report::published::published;
use sps_report::statistics;
use tracing::info;

use crate::output::print_json;

/// Check a dataset and show its statistics
#[derive(clap::Args)]
#[command(
    after_help = "Values of the paper's dataset, and of one that was simulated after it, stand beside \
    the published ones. Ends with status 1 where a frame is missing or broken.\n\n\
    Examples:\n  \
    sps inspect fixtures/tiny-dataset --out runs/inspect\n  \
    sps inspect --config configs/friction-photos.toml"
)]
pub struct Args {
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
    /// Draw the values, as boxes.svg and materials.svg, into this folder; without it nothing is written
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
        print_json(&inspection)?;
    } else {
        print(&inspection, &labels(&dataset), dataset.origin().is_some());
    }
    if let Some(folder) = &args.out {
        draw(&dataset, read.tactile, folder)?;
    }
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
            DataSpec::Folder(folder) => Ok((folder.path, folder.read)),
            _ => bail!(
                "{}: `data.from` is not \"folder\", so there is no folder to inspect; `simulate` writes one",
                config.display()
            ),
        }
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
    let properties = averages.properties().iter().map(ToString::to_string);
    let values = properties.map(|code| {
        let values = averages.column(&code).into_iter().flatten();
        (code, values.collect())
    });
    let values: Vec<(String, Vec<f64>)> = values.collect();
    let boxes = statistics::boxes(&values, dataset.origin().is_some());
    write_atomically(&folder.join("boxes.svg"), boxes.as_bytes())?;
    let donut = statistics::donut(&labels(dataset));
    write_atomically(&folder.join("materials.svg"), donut.as_bytes())?;
    info!("boxes.svg and materials.svg are in {}", folder.display());
    Ok(())
}

fn print(inspection: &Inspection, labels: &[(String, usize)], after_the_paper: bool) {
    let (name, surfaces, groups) = (&inspection.name, inspection.surfaces, inspection.groups);
    let (views, readings) = (inspection.views, inspection.readings);
    println!(
        "{name}: {surfaces} surfaces in {groups} groups, {views} views each, {readings} readings"
    );
    println!("\nmaterials");
    for (name, count) in &inspection.materials {
        println!("  {name:<24}{count:>6}");
    }
    print_labels(inspection.surfaces, labels, after_the_paper);
    let columns = COLUMNS.iter().map(|&column| column.to_owned());
    let heading = columns.filter(|column| after_the_paper || column != PUBLISHED);
    let heading = heading.collect();
    let lines = inspection.properties.iter();
    let lines = lines.map(|property| line(property, after_the_paper));
    let lines: Vec<Vec<String>> = [heading].into_iter().chain(lines).collect();
    print!("\n{}", aligned(&lines, |at| at == 0));
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
    let between = |one: &&PropertySummary| one.between_groups > Some(MOSTLY_BETWEEN);
    let grouped = properties.iter().filter(between);
    let codes: Vec<&str> = grouped.map(|one| one.property.code()).collect();
    if !codes.is_empty() {
        println!(
            "\nmore than half of the variance of {} lies between groups (column `between`): a \
             split `by = \"surface\"` would measure recognition of known groups",
            codes.join(", ")
        );
    }
}

fn print_labels(surfaces: usize, labels: &[(String, usize)], after_the_paper: bool) {
    println!("\nlabels, fewer than {FEWEST_PER_MATERIAL} of a material being `{OTHER}`");
    let heading = if after_the_paper { PUBLISHED } else { "" };
    println!("  {:>39}{heading:>11}", "share");
    for (name, count) in labels {
        let share = 100.0 * *count as f64 / surfaces.max(1) as f64;
        let printed = published().materials.get(name);
        let printed = printed.map_or("–".to_owned(), |share| format!("{:.1} %", 100.0 * share));
        let printed = if after_the_paper { &*printed } else { "" };
        println!("  {name:<24}{count:>6}{share:>7.1} %{printed:>11}");
    }
}

/// Of the table of properties; the last is of five, the published quantiles.
const COLUMNS: [&str; 12] = [
    "", "measured", "missing", "minimum", "quartile", "median", "quartile", "maximum", "outside",
    "repeat", "between", PUBLISHED,
];
const PUBLISHED: &str = "published";

fn line(property: &PropertySummary, after_the_paper: bool) -> Vec<String> {
    let decimals = decimals(spread(property.quantiles));
    let shown = |quantiles: Option<[f64; 5]>| {
        let quantile = |at: usize| number(quantiles.map(|all| all[at]), decimals);
        [0, 1, 2, 3, 4].map(quantile)
    };
    let code = property.property.to_string();
    let printed = shown(published().quantiles.get(&code).copied());
    let outside = property.out_of_range.below + property.out_of_range.above;
    let counts = [property.measured, property.missing_cells].map(|count| count.to_string());
    let others = [
        outside.to_string(),
        number(property.repeat_std, decimals + 1),
        number(property.between_groups, 2),
    ];
    let mut cells = vec![code];
    cells.extend(counts);
    cells.extend(shown(property.quantiles));
    cells.extend(others);
    cells.extend(printed.into_iter().filter(|_| after_the_paper));
    cells
}

/// How far apart the quartiles lie, or the ends where the quartiles are one.
fn spread(quantiles: Option<[f64; 5]>) -> f64 {
    let [lowest, lower, _, upper, highest] = quantiles.unwrap_or_default();
    let (between, ends) = (upper - lower, highest - lowest);
    if between > 0.0 { between } else { ends }
}
