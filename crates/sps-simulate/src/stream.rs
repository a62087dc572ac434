//! Named random streams: every draw comes from a ChaCha stream keyed by (seed, purpose, index).

use sps_base::streams::{ChaCha8Rng, RngCore, hashed_stream};

/// What a stream is drawn for. The names enter the key, so adding one moves no other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Which material each place of a block of surfaces has.
    Assignment,
    /// Which variant of its material a surface is.
    Variant,
    /// The standard-normal scores of the latent causes.
    Latents,
    /// A second, independent set of scores, for the known limit.
    Redraw,
    /// Colours, prints and tone: what can be seen and not felt.
    Appearance,
    /// Threads, cells, strokes and noise of the height field.
    Relief,
    /// Where on the surface it was touched.
    Location,
    /// What differs between touches of one place.
    Repeat,
    /// Photon and read noise.
    Sensor,
    /// Exposure and registration errors.
    Placement,
    /// The formulas of a class of patterns.
    Pattern,
    /// What differs between images of a class of patterns.
    PatternImage,
}

impl Purpose {
    const fn name(self) -> &'static str {
        match self {
            Self::Assignment => "assignment",
            Self::Variant => "variant",
            Self::Latents => "latents",
            Self::Redraw => "redraw",
            Self::Appearance => "appearance",
            Self::Relief => "relief",
            Self::Location => "location",
            Self::Repeat => "repeat",
            Self::Sensor => "sensor",
            Self::Placement => "placement",
            Self::Pattern => "pattern",
            Self::PatternImage => "pattern image",
        }
    }
}

/// A stream of random draws.
#[derive(Clone, Debug)]
pub(crate) struct Stream(ChaCha8Rng);

impl Stream {
    /// The stream of `seed` and `purpose` for the thing that `index` names.
    pub(crate) fn new(seed: u64, purpose: Purpose, index: &[u64]) -> Self {
        let index: Vec<u8> = index.iter().flat_map(|part| part.to_le_bytes()).collect();
        let name = [&seed.to_le_bytes(), purpose.name().as_bytes(), &index];
        Self(hashed_stream("sps-dataset simulate stream 1", name))
    }

    pub(crate) fn bits(&mut self) -> u32 {
        self.0.next_u32()
    }

    pub(crate) fn fill(&mut self, bytes: &mut [u8]) {
        self.0.fill_bytes(bytes);
    }

    /// Uniform in `[0, 1)`, in steps of 2^-24, so that it is exact in f32 and f64.
    pub(crate) fn unit(&mut self) -> f64 {
        f64::from(self.bits() >> 8) / f64::from(1u32 << 24)
    }

    /// Uniform in `[lo, hi)`.
    pub(crate) fn between(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.unit()
    }

    pub(crate) fn between32(&mut self, lo: f64, hi: f64) -> f32 {
        self.between(lo, hi) as f32
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Uniform in `0..count`; `count` is far below 2^24.
    pub(crate) fn index(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// Standard normal, by Box and Muller.
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.unit())).sqrt();
        radius * libm::cos(std::f64::consts::TAU * self.unit())
    }

    /// Which of some weighted things; weights need not sum to one.
    pub(crate) fn weighted(&mut self, weights: impl Iterator<Item = f64> + Clone) -> usize {
        let mut left = self.unit() * weights.clone().sum::<f64>();
        let mut last = 0;
        for (i, weight) in weights.enumerate() {
            last = i;
            left -= weight;
            if left < 0.0 {
                break;
            }
        }
        last
    }
}
