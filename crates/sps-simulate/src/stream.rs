//! Named random streams: every draw comes from a ChaCha stream keyed by (seed, purpose, index).

use sps_base::streams::{ChaCha8Rng, RngCore, hashed_stream};

/// What a stream is drawn for: a name that enters the key, so that adding one moves no other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Purpose(&'static str);

impl Purpose {
    /// Which material each place of a block of surfaces has.
    pub(crate) const ASSIGNMENT: Self = Self("assignment");
    /// Which kind of its material a surface is.
    pub(crate) const VARIANT: Self = Self("variant");
    /// The standard-normal scores of the latent causes.
    pub(crate) const LATENTS: Self = Self("latents");
    /// A second, independent set of scores, for the known limit.
    pub(crate) const REDRAW: Self = Self("redraw");
    /// Colours, prints and tone: what can be seen and not felt.
    pub(crate) const APPEARANCE: Self = Self("appearance");
    /// Threads, cells, strokes and noise of the height field.
    pub(crate) const RELIEF: Self = Self("relief");
    /// Where on the surface it was touched.
    pub(crate) const LOCATION: Self = Self("location");
    /// What differs between touches of one place.
    pub(crate) const REPEAT: Self = Self("repeat");
    /// Photon and read noise.
    pub(crate) const SENSOR: Self = Self("sensor");
    /// Exposure and registration errors.
    pub(crate) const PLACEMENT: Self = Self("placement");
    /// The formulas of a class of patterns.
    pub(crate) const PATTERN: Self = Self("pattern");
    /// What differs between images of a class of patterns.
    pub(crate) const PATTERN_IMAGE: Self = Self("pattern image");
}

/// A stream of random draws.
#[derive(Clone, Debug)]
pub(crate) struct Stream(ChaCha8Rng);

impl Stream {
    /// The stream of `seed` and `purpose` for the thing that `index` names.
    pub(crate) fn new(seed: u64, purpose: Purpose, index: &[u64]) -> Self {
        let index: Vec<u8> = index.iter().flat_map(|part| part.to_le_bytes()).collect();
        let name = [&seed.to_le_bytes(), purpose.0.as_bytes(), &index];
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
