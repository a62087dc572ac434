//! What all images of a class have in common.

use super::motif::{self, Motif};
use super::noise::{reseed, warped};
use crate::stream::Stream;

/// One or two motifs, and how they are seen.
pub(super) struct Class {
    first: Motif,
    second: Option<Second>,
    /// How far places are moved, in features, and how many features a movement reaches over.
    warp: [f32; 2],
    /// Features across an image, before an image's own zoom.
    pub(super) features: f32,
    /// Height of the relief relative to the size of a feature.
    pub(super) relief: f32,
    /// How far apart the colours are: 0 is one colour.
    pub(super) colourful: f32,
    pub(super) colours: usize,
    /// Whether colours end at an edge.
    pub(super) posterised: bool,
    /// Whether most images are turned the same way, as gravity and habit do.
    pub(super) upright: bool,
}

struct Second {
    motif: Motif,
    /// Its features for one of the first motif.
    ratio: f32,
    joined: Joined,
}

enum Joined {
    /// With such a weight.
    Sum(f32),
    /// Where the first is above its middle.
    Inside,
    Product,
    /// The first is the relief, the second the colour.
    Colour,
}

/// What a place of a pattern is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub(super) height: f32,
    pub(super) tone: f32,
}

impl Class {
    pub(super) fn draw(stream: &mut Stream) -> Self {
        let first = motif::draw(stream);
        let second = stream.chance(0.6).then(|| Second {
            motif: motif::draw(stream),
            ratio: log_between(stream, 0.3, 6.0),
            joined: match stream.index(4) {
                0 => Joined::Sum(stream.between32(0.3, 1.2)),
                1 => Joined::Inside,
                2 => Joined::Product,
                _ => Joined::Colour,
            },
        });
        let warp = if stream.chance(0.5) {
            [stream.between32(0.05, 0.5), stream.between32(1.0, 6.0)]
        } else {
            [0.0, 1.0]
        };
        // What has no relief is seen by its colours, and the other way round.
        let relief = stream.between(-0.3, 0.8).max(0.0) as f32;
        let least = if relief > 0.1 { -0.3 } else { 0.3 };
        let colourful = stream.between(least, 1.0).max(0.0);
        Self {
            first,
            second,
            warp,
            features: log_between(stream, 3.0, 24.0),
            relief,
            colourful: colourful as f32,
            colours: 2 + stream.index(4),
            posterised: stream.chance(0.3),
            upright: stream.chance(0.3),
        }
    }

    /// The pattern that a seed makes, at a place in features.
    pub(super) fn at(&self, place: [f32; 2], seed: u32) -> Spot {
        let place = warped(place, reseed(seed, 1), self.warp[0], self.warp[1]);
        let first = (self.first)(place, reseed(seed, 2));
        let Some(second) = &self.second else {
            return Spot::of(first);
        };
        let finer = place.map(|v| v * second.ratio);
        let value = || (second.motif)(finer, reseed(seed, 3));
        match second.joined {
            Joined::Sum(weight) => {
                Spot::of((first + weight * value()) / (1.0 + weight * weight).sqrt())
            }
            Joined::Inside if first > 0.0 => Spot::of(0.6 * value() + 0.4),
            Joined::Inside => Spot::of(first),
            Joined::Product => Spot::of(first * value()),
            Joined::Colour => Spot {
                height: first,
                tone: value(),
            },
        }
    }
}

impl Spot {
    fn of(value: f32) -> Self {
        Self {
            height: value,
            tone: value,
        }
    }
}

/// Uniform in the logarithm.
pub(super) fn log_between(stream: &mut Stream, lo: f64, hi: f64) -> f32 {
    libm::exp(stream.between(libm::log(lo), libm::log(hi))) as f32
}
