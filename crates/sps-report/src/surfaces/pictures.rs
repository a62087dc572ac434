//! Small pictures of surfaces: simulated ones are rendered again by their number, photographs are
//! read where they still are.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, Result};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use sps_dataset::{FrameFormat, Source};
use sps_experiment::config::{DataSpec, Experiment};
use sps_experiment::data;
use sps_experiment::run::CONFIG;
use sps_simulate::Simulator;

const SIDE: usize = 112;

/// A surface as the data has it.
#[derive(Default)]
pub(super) struct Sight {
    pub material: String,
    /// As the template takes them, each itself as an address.
    pub pictures: Vec<Value>,
}

/// Looks at the data of the run in `folder`: at these views of each surface.
pub(super) fn sights(folder: &Path, wanted: &[(&str, Vec<usize>)]) -> Result<Vec<Sight>> {
    let source: Box<dyn Source> = match Experiment::read(&folder.join(CONFIG), &[])?.data {
        DataSpec::Simulated { spec, .. } => {
            let indices = wanted.iter().map(|(surface, _)| number(surface));
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
    let sight = |(surface, views): &(&str, Vec<usize>)| {
        let place = places.get(surface);
        let place = *place.with_context(|| format!("the data has no `{surface}`"))?;
        let picture = |&view: &usize| picture(source.as_ref(), place, view);
        Ok(Sight {
            material: source.surfaces()[place].material.clone(),
            pictures: views.iter().map(picture).collect::<Result<_>>()?,
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

fn picture(source: &dyn Source, surface: usize, view: usize) -> Result<Value> {
    let angle = source.view_angles().get(view);
    let angle = angle.with_context(|| format!("the data has no view {view}"))?;
    let frame = source.frame(surface, view)?;
    let side = SIDE.min(frame.width.min(frame.height));
    let small = frame.resized(side)?;
    let png = FrameFormat::Png.encode(&small)?;
    Ok(json!({
        "angle": in_words(angle.0),
        "address": format!("data:image/png;base64,{}", STANDARD.encode(&png)),
        "width": small.width,
        "height": small.height,
    }))
}

pub(super) fn in_words(degrees: f64) -> String {
    format!("{}°", sps_experiment::text::number(Some(degrees), 1))
}
