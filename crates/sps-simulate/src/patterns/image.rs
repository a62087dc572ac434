//! One image of a class: where it is seen from, its colours, its light and its camera.

use std::f64::consts::TAU;

use sps_dataset::Frame;

use super::class::{Class, Spot, log_between};
use crate::numeric::mix;
use crate::stream::Stream;

/// What differs between images of a class.
#[derive(Debug, Clone)]
pub(super) struct Image {
    /// Makes another piece of the same pattern.
    seed: u32,
    /// From pixels to features.
    across: [[f32; 2]; 2],
    origin: [f32; 2],
    palette: Vec<[f32; 3]>,
    /// Towards the light, of unit length.
    light: [f32; 3],
    ambient: f32,
    gloss: f32,
    /// How the light falls off over the image.
    falloff: [f32; 2],
    exposure: f32,
    contrast: f32,
    /// Passes of a small blur.
    blurs: usize,
    noise: f32,
}

/// Pixels that are computed along a side for each that is shown: edges are then soft.
const FINER: f32 = 1.25;

impl Image {
    /// Of a class, `side` pixels wide.
    pub(super) fn draw(class: &Class, side: usize, stream: &mut Stream) -> Self {
        let features = class.features * log_between(stream, 0.6, 1.7);
        let angle = if class.upright {
            0.15 * stream.normal()
        } else {
            stream.between(0.0, TAU)
        };
        let (sine, cosine) = (libm::sinf(angle as f32), libm::cosf(angle as f32));
        let step = features / (side as f32 * FINER);
        let leaning = 1.0 / stream.between32(0.65, 1.0);
        let mirrored = if stream.chance(0.5) { -1.0 } else { 1.0 };
        let mut between = |lo: f64, hi: f64| stream.between32(lo, hi);
        let (height, turn) = (between(0.3, 1.2), between(0.0, TAU));
        let flat = libm::cosf(height);
        let light = [
            flat * libm::cosf(turn),
            flat * libm::sinf(turn),
            libm::sinf(height),
        ];
        let origin = [between(-500.0, 500.0), between(-500.0, 500.0)];
        let (ambient, gloss) = (between(0.1, 0.6), between(-0.5, 0.6).max(0.0));
        let falloff = [between(-0.4, 0.4), between(-0.4, 0.4)];
        let (exposure, contrast) = (between(0.45, 1.3), between(0.7, 1.4));
        let noise = between(-0.02, 0.04).max(0.0);
        Self {
            seed: stream.bits(),
            across: [
                [step * cosine, -step * sine * leaning],
                [mirrored * step * sine, mirrored * step * cosine * leaning],
            ],
            origin,
            palette: palette(class, stream),
            light,
            ambient,
            gloss,
            falloff,
            exposure,
            contrast,
            blurs: stream.index(4),
            noise,
        }
    }

    /// The photograph, `(side, side)`.
    pub(super) fn frame(&self, class: &Class, side: usize, stream: &mut Stream) -> Frame {
        let fine = (side as f32 * FINER).round() as usize;
        let spots = self.spots(class, fine);
        let mut data = Vec::with_capacity(fine * fine * 3);
        for y in 0..fine {
            for x in 0..fine {
                data.extend(self.light(class, &spots, fine, [x, y]));
            }
        }
        for _ in 0..self.blurs {
            blur(&mut data, fine);
        }
        self.develop(&mut data, stream);
        let frame = Frame {
            width: fine,
            height: fine,
            data,
        };
        match frame.resized(side) {
            Ok(resized) => resized.into_owned(),
            // Only an image without pixels cannot be resized.
            Err(_) => frame,
        }
    }

    fn spots(&self, class: &Class, fine: usize) -> Vec<Spot> {
        let [[xx, xy], [yx, yy]] = self.across;
        let spot = |i: usize| {
            let (x, y) = ((i % fine) as f32, (i / fine) as f32);
            let place = [
                self.origin[0] + xx * x + xy * y,
                self.origin[1] + yx * x + yy * y,
            ];
            class.at(place, self.seed)
        };
        (0..fine * fine).map(spot).collect()
    }

    /// The light that a pixel sends.
    fn light(&self, class: &Class, spots: &[Spot], fine: usize, [x, y]: [usize; 2]) -> [f32; 3] {
        let at = |x: usize, y: usize| &spots[y.min(fine - 1) * fine + x.min(fine - 1)];
        let spot = at(x, y);
        let colour = self.colour(class, spot.tone);
        // Slopes of the relief; a feature is some pixels wide, its height a share of that.
        let pixels = fine as f32 / class.features;
        let slope = |other: &Spot| {
            (class.relief * 0.5 * pixels * (other.height - spot.height)).clamp(-2.0, 2.0)
        };
        let normal = [-slope(at(x + 1, y)), -slope(at(x, y + 1)), 1.0];
        let length = normal.iter().map(|v| v * v).sum::<f32>().sqrt();
        let dot = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        let facing = (dot(&normal, &self.light) / length).max(0.0);
        let half = [self.light[0], self.light[1], self.light[2] + 1.0];
        let half_length = dot(&half, &half).sqrt();
        let mirror = (dot(&normal, &half) / (length * half_length)).max(0.0);
        let shine = self.gloss * mirror.powi(24);
        // What lies low sees less of the sky.
        let open = 1.0 - 0.3 * class.relief * (1.0 - spot.height).clamp(0.0, 1.5);
        let centred = |v: usize| v as f32 / fine as f32 - 0.5;
        let lamp = 1.0 + self.falloff[0] * centred(x) + self.falloff[1] * centred(y);
        let diffuse = self.ambient * open + (1.0 - self.ambient) * facing / self.light[2].max(0.3);
        colour.map(|c| lamp * self.exposure * (c * diffuse + shine))
    }

    fn colour(&self, class: &Class, tone: f32) -> [f32; 3] {
        let last = self.palette.len() - 1;
        let place = (0.5 * (tone + 1.0)).clamp(0.0, 1.0) * last as f32;
        let (low, share) = (place.floor() as usize, place - place.floor());
        let edged = class.posterised;
        let share = if edged { share.round() } else { share };
        let (low, high) = (&self.palette[low], &self.palette[(low + 1).min(last)]);
        std::array::from_fn(|c| mix(low[c], high[c], share))
    }

    /// From light to the values of a display, of a gamma of 2, with noise.
    fn develop(&self, data: &mut [f32], stream: &mut Stream) {
        for value in data {
            let encoded = value.max(0.0).sqrt();
            let grain = self.noise * (stream.unit() + stream.unit() - 1.0) as f32;
            *value = (0.5 + self.contrast * (encoded - 0.5) + grain).clamp(0.0, 1.0);
        }
    }
}

/// Colours in linear light, from the lowest tone to the highest.
fn palette(class: &Class, stream: &mut Stream) -> Vec<[f32; 3]> {
    let grey = stream.chance(0.25);
    let saturation = if grey { 0.0 } else { stream.unit() as f32 };
    let mut colour = || -> [f32; 3] {
        let light = stream.between32(0.02, 0.9);
        std::array::from_fn(|_| {
            let own = stream.unit() as f32;
            mix(light, own * own, saturation * 0.8)
        })
    };
    let base = colour();
    let colours = (0..class.colours).map(|_| {
        let other = colour();
        std::array::from_fn(|c| mix(base[c], other[c], class.colourful))
    });
    colours.collect()
}

/// A quarter, a half and a quarter, along rows and then along columns.
fn blur(data: &mut [f32], side: usize) {
    let row = 3 * side;
    for (step, lines, along) in [(3, side, row), (row, side, 3)] {
        for line in 0..lines {
            for channel in 0..3 {
                let start = line * along + channel;
                let mut before = data[start];
                for i in 0..side {
                    let at = start + i * step;
                    let own = data[at];
                    let next = if i + 1 < side { data[at + step] } else { own };
                    data[at] = 0.25 * before + 0.5 * own + 0.25 * next;
                    before = own;
                }
            }
        }
    }
}
