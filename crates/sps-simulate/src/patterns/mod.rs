//! Images that formulas draw, for pretraining: thousands of classes that no material has.
//!
//! Formula-driven supervision in the manner of Kataoka et al., "Pre-training without Natural
//! Images" (ACCV 2020), and Baradad et al., "Learning to See by Looking at Noise" (NeurIPS 2021).

mod class;
mod image;
mod motif;
mod noise;
#[cfg(test)]
mod tests;

use class::Class;
use image::Image;
use sps_dataset::Frame;

use crate::stream::{Purpose, Stream};

/// Classes of patterns, as many as are asked for.
///
/// A class is one or two formulas with their parameters (noise, stripes, cells, weaves, braids,
/// webs, strokes, leaves, bricks, mirrored tiles, fractals), and how high their relief and how far
/// apart their colours are. Its images differ in everything else: which piece of the pattern is
/// seen, how large and turned which way, in which colours and which light, and how sharp.
///
/// ```
/// use sps_simulate::Patterns;
///
/// let patterns = Patterns::new(7);
/// let frame = patterns.frame(3, 0, 64);
/// assert_eq!((frame.width, frame.height), (64, 64));
/// assert_eq!(frame, patterns.frame(3, 0, 64));
/// assert_ne!(frame, patterns.frame(3, 1, 64));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patterns {
    seed: u64,
}

impl Patterns {
    /// Another seed makes other classes.
    pub const fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// An image of a class, `side x side` pixels; the same bits on every machine.
    pub fn frame(&self, class: usize, number: usize, side: usize) -> Frame {
        let (class, number) = (class as u64, number as u64);
        let drawn = Class::draw(&mut Stream::new(self.seed, Purpose::PATTERN, &[class]));
        let mut stream = Stream::new(self.seed, Purpose::PATTERN_IMAGE, &[class, number]);
        let image = Image::draw(&drawn, side, &mut stream);
        image.frame(&drawn, side, &mut stream)
    }
}
