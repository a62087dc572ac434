//! Images of simulated surfaces and of patterns, one after the other.

use anyhow::Result;
use sps_dataset::{Frame, FrameIndex, Source};
use sps_models::training::{Classes, Parts};
use sps_regress::Readings;
use sps_simulate::{Material, Patterns, Simulator};

use super::config::{PatternsSpec, Pretraining};

/// All images by their numbers: first those of surfaces, then those of patterns, class by class.
pub(crate) struct World {
    simulator: Simulator,
    side: usize,
    frames: Vec<FrameIndex>,
    patterns: Patterns,
    spec: PatternsSpec,
}

impl World {
    pub(crate) fn new(pretraining: &Pretraining) -> Result<Self> {
        Ok(Self {
            simulator: Simulator::new(pretraining.simulated.clone())?,
            side: pretraining.simulated.size,
            frames: frames(pretraining),
            patterns: Patterns::new(pretraining.patterns.seed),
            spec: pretraining.patterns.clone(),
        })
    }

    /// Two worlds of one key have the same images.
    pub(crate) fn key(&self) -> String {
        let (simulated, frames, patterns) = (self.simulator.spec(), &self.frames, &self.spec);
        format!("{simulated:?} {frames:?} {patterns:?}")
    }

    pub(crate) fn len(&self) -> usize {
        self.frames.len() + self.spec.classes * self.spec.images
    }

    pub(crate) fn frame(&self, image: usize) -> Result<Frame> {
        if let Some(&FrameIndex { surface, view }) = self.frames.get(image) {
            return Ok(self.simulator.frame(surface, view)?);
        }
        let (class, number) = self.pattern(image);
        Ok(self.patterns.frame(class, number, self.side))
    }

    /// The class of a pattern's image, and its number within.
    fn pattern(&self, image: usize) -> (usize, usize) {
        let beyond = image - self.frames.len();
        (beyond / self.spec.images, beyond % self.spec.images)
    }

    /// The last surfaces, and the last images of each pattern, are kept for validation: surface `i` is
    /// the same whatever their number.
    pub(crate) fn parts(&self, validation: f64) -> Parts {
        let first_kept = |count: usize| (count as f64 * (1.0 - validation)).round() as usize;
        let surfaces = self.frames.iter().map(|frame| frame.surface + 1).max();
        let surfaces = first_kept(surfaces.unwrap_or(0));
        let images = first_kept(self.spec.images);
        let (training, validation) =
            (0..self.len()).partition(|&image| match self.frames.get(image) {
                Some(frame) => frame.surface < surfaces,
                None => self.pattern(image).1 < images,
            });
        Parts {
            training,
            validation,
        }
    }

    /// The material of each surface; each class of patterns is one more.
    pub(crate) fn classes(&self) -> Result<Classes> {
        let materials = Material::all().len();
        let of_image = (0..self.len()).map(|image| {
            let Some(frame) = self.frames.get(image) else {
                return Ok((materials + self.pattern(image).0) as u32);
            };
            Ok(self.simulator.material(frame.surface)?.index() as u32)
        });
        Ok(Classes {
            of_image: of_image.collect::<Result<_>>()?,
            count: (materials + self.spec.classes) as u32,
        })
    }

    /// What the images of surfaces are rendered from; nothing for those of patterns.
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
