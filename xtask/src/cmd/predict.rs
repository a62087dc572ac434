use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use rayon::prelude::*;
use serde::Serialize;
use sps_estimator::{Answer, Estimate, Estimator, Frame, Scale, Sight};
use tracing::error;

use crate::files::create_folder;
use crate::map;
use crate::progress::Progress;

/// Estimate the tactile properties of surfaces from photographs of them
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask predict --model models/friction photograph.jpg\n  \
    cargo xtask predict --model models/friction --csv photographs/ > estimates.csv\n\nA model of one \
    view takes every photograph for a surface of its own, one of several views the photographs of \
    a folder, or those that are named, for one surface, in the order of their names; --group-by says \
    otherwise. Photographs that cannot be read are named, the others are estimated, and the status \
    is 1."
)]
pub(crate) struct Args {
    /// A folder that `train` wrote
    #[arg(long, value_name = "MODEL_DIR")]
    model: PathBuf,
    /// Bring the shorter side to so many pixels [default: as many as the frames that the model was
    /// fitted on have, which is right where a photograph shows as much of a surface as those did]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u64).range(1..))]
    resize: Option<u64>,
    /// Photographs keep their size: right where a pixel shows as much as in the frames that the model
    /// was fitted on
    #[arg(long, conflicts_with = "resize")]
    keep_size: bool,
    /// What one surface is: an image, a folder, or all that is named
    #[arg(long, value_enum, value_name = "WHAT")]
    group_by: Option<GroupBy>,
    /// Say so where photographs like those that the model was fitted on look as strange with at most
    /// this probability
    #[arg(long, value_name = "P", default_value = "0.05")]
    unfamiliar: f64,
    #[command(flatten)]
    maps: Maps,
    #[command(flatten)]
    format: Format,
    /// PNG, JPEG or EXR, or folders of them
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

/// Maps in place of estimates.
#[derive(clap::Args)]
struct Maps {
    /// Draw a map of this property over each photograph, and write its numbers for NumPy; photographs
    /// keep their size unless --resize says otherwise
    #[arg(long, value_name = "PROPERTY", conflicts_with_all = ["json", "csv", "group_by"])]
    map: Option<String>,
    /// Encode each place of a map as a photograph of its own, as many passes in place of one: what is
    /// said of the crop, where one pass sees beyond its edges
    #[arg(long, requires = "map")]
    alone: bool,
    /// The folder to write maps to
    #[arg(long, value_name = "DIR", default_value = ".", requires = "map")]
    out: PathBuf,
}

/// What is printed in place of a table.
#[derive(clap::Args)]
struct Format {
    /// Print a line of JSON for each surface
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print CSV: a line for each surface and property
    #[arg(long)]
    csv: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum GroupBy {
    Image,
    Folder,
    All,
}

/// Images read ahead while as many are encoded.
const AT_ONCE: usize = 16;

pub(crate) fn run(args: &Args) -> Result<()> {
    let model = Estimator::load(&args.model).context("--model")?;
    let scale = scale(args, &model)?;
    if let Some(property) = &args.maps.map {
        return maps(args, &model, scale, property);
    }
    let surfaces = surfaces(args, &model)?;
    let mut printer = Printer::new(args, &model)?;
    let progress = Progress::new("photographs", surfaces.iter().map(|s| s.images.len()).sum());
    let mut failed = 0;
    let mut chunks = chunks(&surfaces).into_iter();
    let mut at_work = chunks
        .next()
        .map(|chunk| (chunk, read(&model, scale, chunk)));
    while let Some((chunk, photographs)) = at_work {
        let next = chunks.next();
        let (answers, ahead) = rayon::join(
            || answers(&model, photographs),
            || next.map(|next| (next, read(&model, scale, next))),
        );
        for (surface, answer) in chunk.iter().zip(answers) {
            match answer {
                Ok(answer) => printer.print(surface, &answer)?,
                Err(reason) => {
                    failed += 1;
                    error!("{}: {reason:#}", surface.name);
                }
            }
            progress.advance(surface.images.len());
        }
        at_work = ahead;
    }
    printer.end();
    ensure!(
        failed == 0,
        "{failed} of {} surfaces have no estimate",
        surfaces.len()
    );
    Ok(())
}

fn scale(args: &Args, model: &Estimator) -> Result<Scale> {
    let asked = match (args.resize, args.keep_size) {
        (Some(pixels), _) => Scale::ShorterSide(pixels as usize),
        (None, true) => Scale::Keep,
        (None, false) if args.maps.map.is_some() => Scale::Keep,
        (None, false) => Scale::OfModel,
    };
    match model.embedder().resize() {
        Some(own) if args.resize.is_some() || args.keep_size => bail!(
            "--resize, --keep-size: the model itself brings the shorter side of every photograph to {own} pixels"
        ),
        _ => Ok(asked),
    }
}

/// Draws a map over each photograph.
fn maps(args: &Args, model: &Estimator, scale: Scale, property: &str) -> Result<()> {
    let mut paths = Vec::new();
    for path in &args.images {
        if path.is_dir() {
            paths.extend(images(path)?);
        } else {
            paths.push(path.clone());
        }
    }
    create_folder(&args.maps.out)?;
    let wanted = map::Wanted {
        property,
        sight: if args.maps.alone {
            Sight::Alone
        } else {
            Sight::Within
        },
        unfamiliar: args.unfamiliar,
    };
    let progress = Progress::new("maps", paths.len());
    let mut failed = 0;
    for path in &paths {
        let name = path
            .file_stem()
            .unwrap_or(path.as_os_str())
            .to_string_lossy();
        let stem = args.maps.out.join(format!("{name}-{property}"));
        let photograph = model.read(path, scale).map_err(anyhow::Error::from);
        match photograph.and_then(|photograph| wanted.write(model, &photograph, &stem)) {
            Ok(said) => println!("{said}"),
            Err(reason) => {
                failed += 1;
                error!("{}: {reason:#}", path.display());
            }
        }
        progress.advance(1);
    }
    ensure!(
        failed == 0,
        "{failed} of {} photographs have no map",
        paths.len()
    );
    Ok(())
}

/// Photographs of one surface.
struct Surface {
    name: String,
    images: Vec<PathBuf>,
}

impl Surface {
    fn of(path: &Path, images: Vec<PathBuf>) -> Self {
        Self {
            name: path.display().to_string(),
            images,
        }
    }
}

/// The surfaces that are asked for, in the order given; folders in the order of their names.
fn surfaces(args: &Args, model: &Estimator) -> Result<Vec<Surface>> {
    let group_by = args.group_by.unwrap_or(if model.fitted().steps().eq([1]) {
        GroupBy::Image
    } else {
        GroupBy::Folder
    });
    let mut surfaces = Vec::new();
    let mut named = Vec::new();
    for path in &args.images {
        if !path.is_dir() {
            named.push(path.clone());
            continue;
        }
        let images = images(path)?;
        match group_by {
            GroupBy::Folder => surfaces.push(Surface::of(path, images)),
            GroupBy::Image | GroupBy::All => named.extend(images),
        }
    }
    match (group_by, named.first()) {
        (_, None) => {}
        (GroupBy::Image, _) => {
            surfaces.extend(
                named
                    .into_iter()
                    .map(|path| Surface::of(&path, vec![path.clone()])),
            );
        }
        (GroupBy::Folder | GroupBy::All, Some(first)) => {
            surfaces.push(Surface::of(&first.clone(), named));
        }
    }
    Ok(surfaces)
}

/// The images of a folder, by name.
fn images(folder: &Path) -> Result<Vec<PathBuf>> {
    const ENDINGS: [&str; 4] = ["png", "jpg", "jpeg", "exr"];
    let failed = || format!("cannot read {}", folder.display());
    let mut images = Vec::new();
    for entry in fs::read_dir(folder).with_context(failed)? {
        let path = entry.with_context(failed)?.path();
        let ending = path.extension().map(OsStr::to_ascii_lowercase);
        if ending.is_some_and(|ending| ENDINGS.iter().any(|known| ending == *known)) {
            images.push(path);
        }
    }
    ensure!(
        !images.is_empty(),
        "{}: no image, expected {}",
        folder.display(),
        ENDINGS.join(", ")
    );
    images.sort();
    Ok(images)
}

/// Surfaces that are read at once.
fn chunks(surfaces: &[Surface]) -> Vec<&[Surface]> {
    let mut chunks = Vec::new();
    let mut rest = surfaces;
    while !rest.is_empty() {
        let mut images = 0;
        let fits = |surface: &&Surface| {
            images += surface.images.len();
            images <= AT_ONCE
        };
        let (chunk, others) = rest.split_at(rest.iter().take_while(fits).count().max(1));
        chunks.push(chunk);
        rest = others;
    }
    chunks
}

type Read = Vec<Result<Vec<Frame>>>;

fn read(model: &Estimator, scale: Scale, chunk: &[Surface]) -> Read {
    let surface = |surface: &Surface| {
        let images = surface.images.par_iter();
        let frames = images.map(|path| Ok(model.read(path, scale)?));
        frames.collect::<Result<Vec<Frame>>>()
    };
    chunk.par_iter().map(surface).collect()
}

/// What is said of each surface; the photographs of all are encoded together.
fn answers(model: &Estimator, read: Read) -> Vec<Result<Answer>> {
    let each = |photographs: Result<Vec<Frame>>| Ok(model.predict(&photographs?)?);
    let all: Vec<&Frame> = read.iter().flatten().flatten().collect();
    let Ok(values) = model.embedder().embed_each(&all) else {
        // One of them is refused: which, is found one by one.
        return read.into_iter().map(each).collect();
    };
    let width = model.embedder().width();
    let mut values = values.as_slice();
    let mut answers = Vec::new();
    for photographs in read {
        answers.push(photographs.and_then(|photographs| {
            let (own, others) = values.split_at(photographs.len() * width);
            values = others;
            Ok(model.predict_embedded(own, photographs.len())?)
        }));
    }
    answers
}

/// Prints answers as they come.
struct Printer<'a> {
    args: &'a Args,
    level: f64,
    no_interval: BTreeMap<&'a str, &'a str>,
    csv: Option<csv::Writer<io::Stdout>>,
}

/// A line of JSON.
#[derive(Serialize)]
struct Line<'a> {
    surface: &'a str,
    images: &'a [PathBuf],
    level: f64,
    #[serde(flatten)]
    answer: &'a Answer,
    unfamiliar: bool,
    no_interval: &'a BTreeMap<&'a str, &'a str>,
}

impl<'a> Printer<'a> {
    fn new(args: &'a Args, model: &'a Estimator) -> Result<Self> {
        let mut printer = Self {
            args,
            level: model.fitted().level().get(),
            no_interval: model.no_interval(),
            csv: args
                .format
                .csv
                .then(|| csv::Writer::from_writer(io::stdout())),
        };
        if let Some(csv) = &mut printer.csv {
            csv.write_record(["surface", "property", "value", "low", "high", "familiar"])?;
        } else if !args.format.json {
            let share = 100.0 * printer.level;
            println!(
                "{:<4}  {:<26} {:>7}   {share:.0} % interval",
                "", "property", "value"
            );
        }
        Ok(printer)
    }

    fn print(&mut self, surface: &Surface, answer: &Answer) -> Result<()> {
        let unfamiliar = answer.familiar.is_some_and(|p| p <= self.args.unfamiliar);
        if self.args.format.json {
            let line = Line {
                surface: &surface.name,
                images: &surface.images,
                level: self.level,
                answer,
                unfamiliar,
                no_interval: &self.no_interval,
            };
            println!("{}", serde_json::to_string(&line)?);
        } else if let Some(csv) = &mut self.csv {
            let text =
                |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
            for one in &answer.estimates {
                let value = one.value.to_string();
                let numbers = [value, text(one.low), text(one.high), text(answer.familiar)];
                let [value, low, high, familiar] = &numbers;
                csv.write_record([&surface.name, &one.property, value, low, high, familiar])?;
            }
            csv.flush()?;
        } else {
            println!("{}", surface.name);
            answer.estimates.iter().for_each(print_estimate);
            if let Some(p) = answer.familiar.filter(|_| unfamiliar) {
                println!(
                    "      unlike what the model was fitted on (p = {p:.3}): intervals promise nothing here"
                );
            }
        }
        io::stdout().flush()?;
        Ok(())
    }

    fn end(&self) {
        if !self.args.format.json && !self.args.format.csv {
            for (property, reason) in &self.no_interval {
                println!("{property}: no interval, {reason}");
            }
        }
    }
}

fn print_estimate(estimate: &Estimate) {
    let interval = match estimate.low.zip(estimate.high) {
        Some((low, high)) => format!("{low:.1} to {high:.1}"),
        None => "none".to_owned(),
    };
    let Estimate {
        property,
        name,
        value,
        ..
    } = estimate;
    println!("{property:<4}  {name:<26} {value:>7.1}   {interval}");
}
