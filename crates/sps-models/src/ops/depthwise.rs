//! Convolution of each channel by itself.

use rayon::prelude::*;

use super::buffer::Buffer;
use super::product::{Epilogue, Finish};
use super::simd::{Lanes, Level, load};
use super::words::{Arithmetic, Real, Word, WordKernel, read, vectors};

/// The weights of a depth-wise convolution, f32 whatever the feature maps are made of.
#[derive(Debug, Clone)]
pub(crate) struct ChannelWeights {
    level: Level,
    channels: usize,
    /// `(taps, channels)`
    data: Buffer,
}

impl ChannelWeights {
    /// Packs weights `(channels, taps)`.
    pub(crate) fn pack(level: Level, taps: usize, weights: &[f32]) -> Self {
        let channels = weights.len() / taps;
        let mut data = Buffer::zeros(weights.len());
        for (tap, row) in data.chunks_exact_mut(channels).enumerate() {
            for (out, weights) in row.iter_mut().zip(weights.chunks_exact(taps)) {
                *out = weights[tap];
            }
        }
        Self {
            level,
            channels,
            data,
        }
    }
}

/// A depth-wise convolution over a source that has its padding around it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DepthwiseProduct<'a, W = f32> {
    pub(crate) source: &'a [W],
    /// Where the window begins for each pixel.
    pub(crate) starts: &'a [usize],
    /// How far from there its pixels lie.
    pub(crate) taps: &'a [usize],
    pub(crate) weights: &'a ChannelWeights,
    /// What happens to the sums; factors and shifts are those of frame 0.
    pub(crate) epilogue: Epilogue<'a>,
}

impl<W: Word> DepthwiseProduct<'_, W> {
    /// Writes pixel `i` at `places[i] - origin` of the target.
    pub(crate) fn write(&self, target: &mut [W], places: &[usize], origin: usize) {
        let write = Write {
            product: self,
            target,
            places,
            origin,
        };
        W::run(self.weights.level, write);
    }
}

struct Write<'a, 'b, W> {
    product: &'a DepthwiseProduct<'b, W>,
    target: &'a mut [W],
    places: &'a [usize],
    origin: usize,
}

impl<W: Word> WordKernel<W> for Write<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(mut self, lanes: S, arithmetic: A) {
        let count = self.places.len();
        let mut first = 0;
        if S::REGISTER_COUNT >= 32 {
            while first + 8 <= count {
                self.pixels::<S, A, 8>(lanes, arithmetic, first);
                first += 8;
            }
        }
        while first + 4 <= count {
            self.pixels::<S, A, 4>(lanes, arithmetic, first);
            first += 4;
        }
        for first in first..count {
            self.pixels::<S, A, 1>(lanes, arithmetic, first);
        }
    }
}

impl<W: Word> Write<'_, '_, W> {
    /// `H` pixels, all channels: two vectors at a time, one, and what is left.
    #[inline(always)]
    fn pixels<S, A, const H: usize>(&mut self, lanes: S, arithmetic: A, first: usize)
    where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let channels = self.product.weights.channels;
        let mut channel = 0;
        while channel + 2 * S::F32_LANES <= channels {
            self.tile::<S, A, H, 2, true>(lanes, arithmetic, first, channel);
            channel += 2 * S::F32_LANES;
        }
        if channel + S::F32_LANES <= channels {
            self.tile::<S, A, H, 1, true>(lanes, arithmetic, first, channel);
            channel += S::F32_LANES;
        }
        if channel < channels {
            self.tile::<S, A, H, 1, false>(lanes, arithmetic, first, channel);
        }
    }

    /// `NV` vectors of `H` pixels' channels, from `channel` on; `WHOLE` where there are as many.
    #[inline(always)]
    fn tile<S, A, const H: usize, const NV: usize, const WHOLE: bool>(
        &mut self,
        lanes: S,
        arithmetic: A,
        first: usize,
        channel: usize,
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let DepthwiseProduct {
            source,
            starts,
            taps,
            weights,
            epilogue,
        } = *self.product;
        let count = (weights.channels - channel).min(NV * S::F32_LANES);
        let (word, words) = (W::words(channel), W::words(count));
        let starts: [usize; H] = std::array::from_fn(|i| starts[first + i] + word);
        let mut sums = [[lanes.splat_f32s(0.0); NV]; H];
        for (&tap, row) in taps.iter().zip(weights.data.chunks_exact(weights.channels)) {
            let weights = vectors::<S, NV, WHOLE>(lanes, &row[channel..channel + count]);
            for i in 0..H {
                let from = starts[i] + tap;
                let x = read::<W, S, A, NV, WHOLE>(lanes, arithmetic, &source[from..from + words]);
                for v in 0..NV {
                    sums[i][v] = lanes.fma(x[v], weights[v], sums[i][v]);
                }
            }
        }
        let finish = Finish::<S, NV>::new(lanes, epilogue, 0, (channel, count));
        for (i, mut ended) in sums.into_iter().enumerate() {
            let place = self.places[first + i] - self.origin + word;
            let out = &mut self.target[place..place + words];
            let stored = if finish.accumulate {
                read::<W, S, A, NV, WHOLE>(lanes, arithmetic, out)
            } else {
                [lanes.splat_f32s(0.0); NV]
            };
            // A closure of as much is not inlined, and runs without the instructions.
            for v in 0..NV {
                ended[v] = finish.apply_to(lanes, arithmetic, v, ended[v], stored[v]);
            }
            if WHOLE {
                arithmetic.store::<NV>(lanes, ended, out);
            } else {
                arithmetic.store_part::<NV>(lanes, ended, out);
            }
        }
    }
}

/// The gradient of a depth-wise convolution's weights.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DepthwiseOuter<'a> {
    pub(crate) level: Level,
    pub(crate) channels: usize,
    pub(crate) taps: &'a [usize],
}

/// Pixels whose products are summed before the sum joins a longer one.
const PIXELS: usize = 256;

/// Vectors of channels whose sums are held in registers together.
const VECTORS: usize = 4;

impl DepthwiseOuter<'_> {
    /// Writes `(channels, taps)`: sums over pixels of the source, from `starts` on, times the gradient
    /// at `places`.
    pub(crate) fn write<W: Real>(
        &self,
        source: &[W],
        starts: &[usize],
        gradient: &[W],
        places: &[usize],
        target: &mut [f32],
    ) {
        let sums = self.taps.par_iter().map(|&tap| {
            let sums = TapSums {
                channels: self.channels,
                source: &source[tap..],
                starts,
                gradient,
                places,
            };
            W::run(self.level, sums)
        });
        let sums: Vec<Vec<f32>> = sums.collect();
        for (channel, target) in target.chunks_exact_mut(self.taps.len()).enumerate() {
            for (target, sums) in target.iter_mut().zip(&sums) {
                *target = sums[channel];
            }
        }
    }
}

/// The sums of one tap.
struct TapSums<'a, W> {
    channels: usize,
    source: &'a [W],
    starts: &'a [usize],
    gradient: &'a [W],
    places: &'a [usize],
}

impl<W: Real> WordKernel<W> for TapSums<'_, W> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(self, lanes: S, arithmetic: A) -> Vec<f32> {
        let mut total = vec![0.0; self.channels];
        let blocks = self.starts.chunks(PIXELS).zip(self.places.chunks(PIXELS));
        for (starts, places) in blocks {
            let step = VECTORS * S::F32_LANES;
            for (part, total) in total.chunks_mut(step).enumerate() {
                let channel = part * step;
                if total.len() == step {
                    let pixels = (starts, places);
                    self.add::<S, A, VECTORS, true>(lanes, arithmetic, pixels, channel, total);
                } else {
                    for (part, total) in total.chunks_mut(S::F32_LANES).enumerate() {
                        let channel = channel + part * S::F32_LANES;
                        let pixels = (starts, places);
                        self.add::<S, A, 1, false>(lanes, arithmetic, pixels, channel, total);
                    }
                }
            }
        }
        total
    }
}

impl<W: Real> TapSums<'_, W> {
    /// Adds the sums over some pixels of the channels from one on; `WHOLE` if they fill the vectors.
    #[inline(always)]
    fn add<S, A, const NV: usize, const WHOLE: bool>(
        &self,
        lanes: S,
        arithmetic: A,
        (starts, places): (&[usize], &[usize]),
        channel: usize,
        total: &mut [f32],
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let (word, words) = (W::words(channel), W::words(total.len()));
        let mut sums = [lanes.splat_f32s(0.0); NV];
        for (&start, &place) in starts.iter().zip(places) {
            let x = &self.source[start + word..][..words];
            let x = read::<W, S, A, NV, WHOLE>(lanes, arithmetic, x);
            let y = &self.gradient[place + word..][..words];
            let y = read::<W, S, A, NV, WHOLE>(lanes, arithmetic, y);
            for v in 0..NV {
                sums[v] = lanes.fma(x[v], y[v], sums[v]);
            }
        }
        for (sums, total) in sums.into_iter().zip(total.chunks_mut(S::F32_LANES)) {
            let sum = lanes.add_f32s(sums, load(lanes, total));
            lanes.partial_store_f32s(total, sum);
        }
    }
}
