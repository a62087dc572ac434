use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use serde::Serialize;
use sps_estimator::{Estimator, Scale, Sight, photographs_in};
use sps_experiment::files::create_folder;
use sps_experiment::progress::Progress;
use tracing::error;

use crate::map::Numbers;
use crate::{answer, map};

/// Draw a property over photographs, place by place
#[derive(clap::Args)]
#[command(
    after_help = "Writes beside each other a PNG, unfamiliar places hatched, and the numbers for NumPy: \
    value, low, high, familiarity.\n\nExample:\n  \
    sps map models/friction hardness photograph.jpg --out maps"
)]
pub struct Args {
    /// A folder that `fit` wrote
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// One of the model's properties
    #[arg(value_name = "PROPERTY")]
    property: String,
    /// Bring the shorter side to so many pixels [default: photographs keep their size]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u64).range(1..))]
    resize: Option<u64>,
    /// Encode each place as a photograph of its own: slower, but nothing beyond its edges is seen
    #[arg(long)]
    alone: bool,
    /// Hatch unfamiliar places: at most this share of photographs like the fitted ones look as strange
    #[arg(long, value_name = "P", default_value = "0.05", value_parser = answer::probability)]
    unfamiliar: f64,
    /// The folder to write to
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Write no files, and print the numbers: a line of JSON for each photograph
    #[arg(long, conflicts_with = "out")]
    json: bool,
    /// PNG, JPEG or EXR, or folders of them
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let model = Estimator::load(&args.model)?;
    answer::check_photographs(&model)?;
    let sight = if args.alone {
        Sight::Alone
    } else {
        Sight::Within
    };
    let wanted = map::Wanted::new(&model, &args.property, sight, args.unfamiliar)?;
    let resize = args.resize.map(|pixels| pixels as usize);
    let scale = resize.map_or(Scale::Keep, Scale::ShorterSide);
    let photographs = photographs(args)?;
    if !args.json {
        create_folder(&args.out)?;
    }
    let progress = Progress::new("maps", photographs.len());
    let mut failed = 0;
    for (stem, path) in &photographs {
        let read = model.read(path, scale).map_err(anyhow::Error::from);
        let mapped = read.and_then(|photograph| {
            if !args.json {
                return wanted.write(&model, (&photograph, path), stem);
            }
            let mapped = wanted.of(&model, &photograph)?;
            let line = Line {
                image: path,
                numbers: mapped.numbers(&model),
            };
            Ok(serde_json::to_string(&line)?)
        });
        match mapped {
            Ok(said) => println!("{said}"),
            Err(reason) => {
                failed += 1;
                error!("{}: {reason:#}", path.display());
            }
        }
        progress.advance(1);
    }
    let all = photographs.len();
    ensure!(failed == 0, "{failed} of {all} photographs have no map");
    Ok(())
}

/// What `--json` prints.
#[derive(Serialize)]
struct Line<'a> {
    image: &'a Path,
    #[serde(flatten)]
    numbers: Numbers<'a>,
}

/// The photographs, by what the names of their maps begin with.
fn photographs(args: &Args) -> Result<BTreeMap<PathBuf, PathBuf>> {
    let mut photographs: BTreeMap<PathBuf, PathBuf> = BTreeMap::new();
    let mut add = |path: PathBuf| {
        let name = path.file_stem().unwrap_or(path.as_os_str());
        let name = format!("{}-{}", Path::new(name).display(), args.property);
        let stem = args.out.join(name);
        if let Some(other) = photographs.get(&stem) {
            let [one, other, map] = [other, &path, &stem].map(|path| path.display());
            bail!(
                "{one} and {other} would have the same map, {map}: ask for one at a time, each with its own --out"
            );
        }
        if !args.json {
            check_free(&map::with_ending(&stem, ".png"), &path)?;
        }
        photographs.insert(stem, path);
        Ok(())
    };
    for path in &args.images {
        if path.is_dir() {
            photographs_in(path)?.into_iter().try_for_each(&mut add)?;
        } else {
            add(path.clone())?;
        }
    }
    Ok(photographs)
}

/// Refuses to write over a file that is not a map of the same photograph.
fn check_free(map: &Path, photograph: &Path) -> Result<()> {
    if !map.exists() {
        return Ok(());
    }
    let there = format!("{} is there already", map.display());
    match map::source(map) {
        Some(source) if Path::new(&source) == photograph => Ok(()),
        Some(source) => bail!(
            "{there}, the map of {source}: remove it, or choose another --out for {}",
            photograph.display()
        ),
        None => bail!(
            "{there}, and is no map that names its photograph: remove it, or choose another --out"
        ),
    }
}
