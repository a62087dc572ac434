//! Small pictures of surfaces: simulated ones are rendered again by their number, photographs are
//! read where they still are.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, Result};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use sps_dataset::{FrameFormat, Source};
use sps_experiment::config::{DataSpec, Experiment};
use sps_experiment::data;
use sps_experiment::run::CONFIG;
use sps_simulate::Simulator;

const SIDE: usize = 112;

/// What of a surface is to be seen.
pub(super) struct Wanted<'a> {
    pub surface: &'a str,
    /// Indices of views.
    pub views: Vec<usize>,
}

/// A surface as the data has it.
#[derive(Default)]
pub(super) struct Sight {
    pub material: String,
    pub pictures: Vec<Picture>,
}

#[derive(Serialize)]
pub(super) struct Picture {
    angle: String,
    /// The picture itself, as an address.
    address: String,
    width: usize,
    height: usize,
}

/// Looks at the data of the run in `folder`: of each surface what is wanted.
pub(super) fn sights(folder: &Path, wanted: &[Wanted<'_>]) -> Result<Vec<Sight>> {
    let source: Box<dyn Source> = match Experiment::read(&folder.join(CONFIG), &[])?.data {
        DataSpec::Simulated { spec, .. } => {
            let indices = wanted.iter().map(|one| number(one.surface));
            let indices = indices.collect::<Result<Vec<usize>>>()?;
            Box::new(Simulator::of(spec, &indices)?)
        }
        mut data => {
            if let DataSpec::Folder(folder) = &mut data {
                folder.near_twins = 0.0;
            }
            data::open(&data)?.0
        }
    };
    let surfaces = source.surfaces().iter().enumerate();
    let places: HashMap<&str, usize> = surfaces.map(|(at, s)| (s.id.as_str(), at)).collect();
    let sight = |wanted: &Wanted<'_>| {
        let place = places.get(wanted.surface);
        let place = *place.with_context(|| format!("the data has no `{}`", wanted.surface))?;
        let views = wanted.views.iter();
        let pictures = views.map(|&view| picture(source.as_ref(), place, view));
        Ok(Sight {
            material: source.surfaces()[place].material.clone(),
            pictures: pictures.collect::<Result<_>>()?,
        })
    };
    wanted.iter().map(sight).collect()
}

/// The index that a simulated surface has its name from.
fn number(name: &str) -> Result<usize> {
    let digits = name.strip_prefix('s').unwrap_or(name);
    let number = digits.parse();
    number.with_context(|| format!("`{name}` is no simulated surface, which are `s` and a number"))
}

fn picture(source: &dyn Source, surface: usize, view: usize) -> Result<Picture> {
    let angle = source.view_angles().get(view);
    let angle = angle.with_context(|| format!("the data has no view {view}"))?;
    let frame = source.frame(surface, view)?;
    let side = SIDE.min(frame.width.min(frame.height));
    let small = frame.resized(side)?;
    let png = FrameFormat::Png.encode(&small)?;
    Ok(Picture {
        angle: in_words(angle.0),
        address: format!("data:image/png;base64,{}", STANDARD.encode(&png)),
        width: small.width,
        height: small.height,
    })
}

pub(super) fn in_words(degrees: f64) -> String {
    format!("{}°", sps_experiment::text::number(Some(degrees), 1))
}
