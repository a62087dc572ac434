//! Maps over photographs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use sps_estimator::{Estimator, Scale, Sight, photographs_in};
use sps_experiment::files::create_folder;
use sps_experiment::progress::Progress;
use tracing::error;

use super::Args;
use crate::map;

/// Maps in place of estimates.
#[derive(clap::Args)]
pub(super) struct Options {
    /// Draw a map of this property over each photograph, and write its numbers for NumPy; photographs
    /// keep their size unless --resize says otherwise
    #[arg(long, value_name = "PROPERTY", conflicts_with_all = ["json", "csv", "group_by"])]
    pub map: Option<String>,
    /// Encode each place of a map as a photograph of its own, as many passes in place of one: what is
    /// said of the crop, where one pass sees beyond its edges
    #[arg(long, requires = "map")]
    alone: bool,
    /// The folder to write maps to
    #[arg(long, value_name = "DIR", default_value = ".", requires = "map")]
    out: PathBuf,
}

/// Draws a map over each photograph.
pub(super) fn draw(args: &Args, model: &Estimator, property: &str) -> Result<()> {
    let options = &args.maps;
    let wanted = map::Wanted {
        property,
        at: map::place(model, property).context("--map")?,
        sight: if options.alone {
            Sight::Alone
        } else {
            Sight::Within
        },
        unfamiliar: args.unfamiliar,
    };
    let scale = match args.resize {
        Some(pixels) => Scale::ShorterSide(pixels as usize),
        None => Scale::Keep,
    };
    let photographs = photographs(args, property)?;
    create_folder(&options.out)?;
    let progress = Progress::new("maps", photographs.len());
    let mut failed = 0;
    for (stem, path) in &photographs {
        let drawn = model.read(path, scale).map_err(anyhow::Error::from);
        match drawn.and_then(|photograph| wanted.write(model, (&photograph, path), stem)) {
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
        photographs.len()
    );
    Ok(())
}

/// The photographs, by what the names of their maps begin with.
fn photographs(args: &Args, property: &str) -> Result<BTreeMap<PathBuf, PathBuf>> {
    let mut photographs = BTreeMap::new();
    let mut add = |path: PathBuf| {
        let name = path.file_stem().unwrap_or(path.as_os_str());
        let name = format!("{}-{property}", Path::new(name).display());
        let stem = args.maps.out.join(name);
        if let Some(other) = photographs.get(&stem) {
            let other: &PathBuf = other;
            bail!(
                "{} and {} would have the same map, {}: ask for one at a time, each with its own --out",
                other.display(),
                path.display(),
                stem.display()
            );
        }
        check_free(&map::with_ending(&stem, ".png"), &path)?;
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
    match map::source(map) {
        Some(source) if Path::new(&source) == photograph => Ok(()),
        Some(source) => bail!(
            "{} is there already, the map of {source}: remove it, or choose another --out for {}",
            map.display(),
            photograph.display()
        ),
        None => bail!(
            "{} is there already, and is no map that names its photograph: remove it, or choose another \
            --out",
            map.display()
        ),
    }
}
