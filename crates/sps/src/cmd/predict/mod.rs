mod embedded;
mod lines;
mod print;

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use rayon::prelude::*;
use sps_estimator::{Answer, Estimator, Frame, Scale, Watch, photographs_in};
use sps_experiment::progress::Progress;
use tracing::{error, warn};

use self::print::Printer;
use crate::answer;

/// Estimate the tactile properties of surfaces from photographs of them
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  sps predict models/friction photograph.jpg\n  \
    sps predict models/friction --csv photographs/ > estimates.csv\n\nWhich photographs show one surface, \
    unless --group-by says otherwise:\n- to a model of one view, each is a surface of its own\n- to a model of \
    several views, those of a folder, or all that are named one by one, are one surface\n\nThey are taken in the \
    order of the model's angles: those of a folder by name, others as they are given. A row of --embeddings is a \
    photograph; as many as the model has views, one after the other, are of one surface.\n\nPhotographs that cannot \
    be read are named, the others are estimated, and the status is 1.\n\nBy default photographs are brought to the \
    size of the frames that the model was fitted on, which is right if they show as much of a surface. --keep-size is \
    right if a pixel shows as much.\n\nWith - photographs are read from standard input. A line is a JSON string, the \
    path of one, or a list of those of a surface. It is answered by a line of JSON before the next is read."
)]
pub struct Args {
    /// A folder that `fit` wrote
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// Bring the shorter side to so many pixels [default: as many as the model was fitted on]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u64).range(1..))]
    resize: Option<u64>,
    /// Photographs keep their size
    #[arg(long, conflicts_with = "resize")]
    keep_size: bool,
    /// What one surface is: an image, a folder, or all that is named
    #[arg(long, value_enum, value_name = "WHAT")]
    group_by: Option<GroupBy>,
    /// Call a photograph unfamiliar if at most this share of those like the fitted ones look as strange
    #[arg(long, value_name = "P", default_value = "0.05", value_parser = answer::probability)]
    unfamiliar: f64,
    /// Wider intervals, which hold the truths of all properties of a surface at once
    #[arg(long)]
    joint: bool,
    #[command(flatten)]
    format: print::Format,
    /// A file as `fit --embeddings` takes it, in place of photographs
    #[arg(long, value_name = "FILE", conflicts_with_all = ["images", "resize", "keep_size", "group_by"])]
    embeddings: Option<PathBuf>,
    /// PNG, JPEG or EXR, or folders of them; or -, for lines of standard input
    #[arg(required_unless_present = "embeddings", value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum GroupBy {
    Image,
    Folder,
    All,
}

/// Images read ahead while as many are encoded; where they keep their size, one for each thread.
const AT_ONCE: usize = 16;

pub(crate) fn run(args: &Args) -> Result<()> {
    let model = Estimator::load(&args.model)?;
    let model = if args.joint { model.jointly() } else { model };
    if let Some(file) = &args.embeddings {
        return embedded::answer(args, &model, file);
    }
    answer::check_photographs(&model)?;
    let scale =
        answer::scale(&model, args.resize, args.keep_size).context("--resize, --keep-size")?;
    if args.images == [Path::new("-")] {
        let (json, csv) = (true, false);
        let format = print::Format { json, csv };
        let printer = Printer::new(&format, args.unfamiliar, &model)?;
        return lines::answer(&model, scale, printer);
    }
    let surfaces = surfaces(args, &model)?;
    let mut printer = Printer::new(&args.format, args.unfamiliar, &model)?;
    let watch = Watch::new(&model).ok();
    let progress = Progress::new("photographs", surfaces.iter().map(|s| s.images.len()).sum());
    let (mut failed, mut scores) = (0, Vec::new());
    let at_once = match scale {
        Scale::Keep => rayon::current_num_threads(),
        _ => AT_ONCE,
    };
    let mut chunks = chunks(&surfaces, at_once).into_iter();
    let mut next = || {
        let chunk = chunks.next()?;
        Some((chunk, read(&model, scale, chunk)))
    };
    let mut at_work = next();
    while let Some((chunk, photographs)) = at_work {
        let (answers, ahead) =
            rayon::join(|| answers(&model, photographs, watch.as_ref()), &mut next);
        for (surface, answer) in chunk.iter().zip(answers) {
            match answer {
                Ok((answer, score)) => {
                    printer.print(surface, &answer)?;
                    scores.extend(score);
                }
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
    warn_of_drift(watch, scores);
    let all = surfaces.len();
    ensure!(failed == 0, "{failed} of {all} surfaces have no estimate");
    Ok(())
}

fn warn_of_drift(watch: Option<Watch<&Estimator>>, scores: Vec<f64>) {
    let Some(mut watch) = watch else { return };
    watch.see_in_any_order(scores);
    if watch.alarm().is_some() {
        warn!(
            "the photographs are, as a whole, unlike those that the model was fitted on: intervals may not hold \
            (by chance it says so in one of 100 runs at most)"
        );
    }
}

/// Photographs of one surface.
struct Surface {
    name: String,
    images: Vec<PathBuf>,
}

impl Surface {
    /// Called after its first photograph.
    fn of(images: Vec<PathBuf>) -> Self {
        let name = images.first().map(|first| first.display().to_string());
        Self {
            name: name.unwrap_or_default(),
            images,
        }
    }
}

/// The surfaces that are asked for, in the order given; the photographs of a folder by name.
fn surfaces(args: &Args, model: &Estimator) -> Result<Vec<Surface>> {
    let group_by = args.group_by.unwrap_or(if model.fitted().steps().eq([1]) {
        GroupBy::Image
    } else {
        GroupBy::Folder
    });
    let (mut surfaces, mut named) = (Vec::new(), Vec::new());
    for path in &args.images {
        if !path.is_dir() {
            named.push(path.clone());
        } else if group_by == GroupBy::Folder {
            surfaces.push(Surface {
                name: path.display().to_string(),
                images: photographs_in(path)?,
            });
        } else {
            named.extend(photographs_in(path)?);
        }
    }
    if group_by == GroupBy::Image {
        surfaces.extend(named.into_iter().map(|path| Surface::of(vec![path])));
    } else if !named.is_empty() {
        surfaces.push(Surface::of(named));
    }
    Ok(surfaces)
}

/// Surfaces that are read at once: those of so many images, at least one.
fn chunks(surfaces: &[Surface], at_once: usize) -> Vec<&[Surface]> {
    let mut chunks = Vec::new();
    let mut rest = surfaces;
    while !rest.is_empty() {
        let mut images = 0;
        let fits = |surface: &&Surface| {
            images += surface.images.len();
            images <= at_once
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

/// What is said of each surface, and how strange it looks; the photographs of all are encoded together.
fn answers(
    model: &Estimator,
    read: Read,
    watch: Option<&Watch<&Estimator>>,
) -> Vec<Result<(Answer, Option<f64>)>> {
    let all: Vec<&Frame> = read.iter().flatten().flatten().collect();
    let together = model.embedder().embed(&all).ok();
    let mut together = together.as_deref();
    let width = model.embedder().width();
    let mut answer = |photographs: Result<Vec<Frame>>| {
        let photographs = photographs?;
        let own = match &mut together {
            Some(values) => {
                let own = values.split_off(..photographs.len() * width);
                Cow::Borrowed(own.unwrap_or_default())
            }
            // One of all is refused: which, is found one by one.
            None => Cow::Owned(model.embedder().embed(&photographs)?),
        };
        let answer = model.predict_embedded(&own, photographs.len())?;
        // Several photographs are of one surface, and all but the first tell nothing of a next.
        let first = own.get(..model.about().angles.len() * width);
        let score = watch.zip(first).map(|(watch, first)| watch.score(first));
        Ok((answer, score.transpose()?))
    };
    read.into_iter().map(&mut answer).collect()
}
