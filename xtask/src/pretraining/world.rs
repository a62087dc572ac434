//! Images of simulated surfaces and of patterns, one after the other.

use std::ops::Range;

use anyhow::Result;
use sps_dataset::{Frame, FrameIndex, Source};
use sps_models::training::{Classes, Parts};
use sps_regress::Readings;
use sps_simulate::{Material, Patterns, Simulator};

use super::config::{KeptSpec, Pretraining};

/// All images by their numbers: first those of surfaces, then those of patterns.
pub(crate) struct World {
    simulator: Simulator,
    side: usize,
    frames: Vec<FrameIndex>,
    patterns: Patterns,
    kept: KeptSpec,
}

impl World {
    pub(crate) fn new(pretraining: &Pretraining) -> Result<Self> {
        Ok(Self {
            simulator: Simulator::new(pretraining.simulated.clone())?,
            side: pretraining.simulated.size,
            frames: frames(pretraining),
            patterns: Patterns::new(pretraining.kept.seed),
            kept: pretraining.kept.clone(),
        })
    }

    /// Two worlds of one key have the same images.
    pub(crate) fn key(&self) -> String {
        let (simulated, frames, kept) = (self.simulator.spec(), &self.frames, &self.kept);
        format!("{simulated:?} {frames:?} {kept:?}")
    }

    pub(crate) fn len(&self) -> usize {
        self.frames.len() + self.kept.patterns
    }

    /// The images that are not of surfaces.
    pub(crate) fn others(&self) -> Range<usize> {
        self.frames.len()..self.len()
    }

    pub(crate) fn frame(&self, image: usize) -> Result<Frame> {
        if let Some(&FrameIndex { surface, view }) = self.frames.get(image) {
            return Ok(self.simulator.frame(surface, view)?);
        }
        // Each of a class of its own.
        let class = image - self.frames.len();
        Ok(self.patterns.frame(class, 0, self.side))
    }

    /// The last surfaces are held out for validation: surface `i` is the same whatever their number.
    pub(crate) fn parts(&self, validation: f64) -> Parts {
        let surfaces = self.frames.last().map_or(0, |frame| frame.surface + 1);
        let first_held_out = (surfaces as f64 * (1.0 - validation)).round() as usize;
        let trained = |&image: &usize| {
            let frame = self.frames.get(image);
            frame.is_none_or(|frame| frame.surface < first_held_out)
        };
        let (training, validation) = (0..self.len()).partition(trained);
        Parts {
            training,
            validation,
        }
    }

    /// The material of each surface; the class after the materials is that of images of none.
    pub(crate) fn classes(&self) -> Result<Classes> {
        let materials = Material::all().len() as u32;
        let surfaces = self.frames.iter().map(|frame| {
            let material = self.simulator.material(frame.surface)?;
            Ok(material.index() as u32)
        });
        let mut of_image: Vec<u32> = surfaces.collect::<Result<_>>()?;
        of_image.resize(self.len(), materials);
        Ok(Classes {
            of_image,
            count: materials + 1,
        })
    }

    /// What the images of surfaces are rendered from; nothing for the others.
    pub(crate) fn visible(&self) -> Result<Readings> {
        let mut rows = Vec::new();
        for frame in &self.frames {
            let seen = self.simulator.parameters(frame.surface)?;
            let values = [
                seen.period_mm.ln(),
                seen.relief_mm.ln(),
                seen.regularity,
                seen.micro_um.ln(),
                seen.micro_length_mm.ln(),
                seen.alpha.ln(),
                seen.sheen,
            ];
            // What a surface does not have has no logarithm.
            rows.push(values.map(|v| Some(v).filter(|v| v.is_finite())).to_vec());
        }
        rows.resize(self.len(), vec![None; VISIBLE.len()]);
        Ok(Readings::new(VISIBLE.map(str::to_owned).to_vec(), &rows)?)
    }
}

/// What is seen of each surface.
const VISIBLE: [&str; 7] = [
    "log-period",
    "log-relief",
    "regularity",
    "log-microrelief",
    "log-microrelief-length",
    "log-roughness",
    "sheen",
];

/// One view of each surface from each range of angles, somewhere in it.
fn frames(pretraining: &Pretraining) -> Vec<FrameIndex> {
    let (views, ranges) = (pretraining.simulated.views, pretraining.views_per_surface);
    let view = |surface: usize, range: usize| {
        let (from, to) = (range * views / ranges, (range + 1) * views / ranges);
        let draw = blake3::hash(format!("{} {surface} {range}", pretraining.seed).as_bytes());
        from + usize::from(draw.as_bytes()[0]) * (to - from) / 256
    };
    let mut frames = Vec::new();
    for surface in 0..pretraining.simulated.surfaces {
        let views = (0..ranges).map(|range| view(surface, range));
        frames.extend(views.map(|view| FrameIndex { surface, view }));
    }
    frames
}
