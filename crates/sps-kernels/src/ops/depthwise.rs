//! Convolution of each channel by itself.
//!
//! Windows that lie side by side share the columns that they share: a tile reads each once.

use std::ops::Range;

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
    /// Words from one pixel of the source to the next.
    pub(crate) pitch: usize,
    /// Pixels from one place of the window to the next in a row.
    pub(crate) stride: usize,
    /// Pixels in a row of the window, which lie side by side one way or the other.
    pub(crate) columns: usize,
    pub(crate) weights: &'a ChannelWeights,
    /// What happens to the sums; factors and shifts are those of frame 0.
    pub(crate) epilogue: Epilogue<'a>,
}

impl<W: Word> DepthwiseProduct<'_, W> {
    /// Whether the pixels in a row of the window lie in the order against that of places.
    #[inline(always)]
    fn backwards(&self) -> bool {
        matches!(self.taps, [first, second, ..] if second < first)
    }

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

/// Pixels in a row whose sums are held in registers together: a row of the smallest map of an image of 224 pixels, by
/// two vectors of channels.
const SIDE_BY_SIDE: usize = 7;

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
        let DepthwiseProduct {
            starts,
            pitch,
            stride,
            columns,
            weights: ChannelWeights { channels, .. },
            ..
        } = *self.product;
        let whole = channels - channels % S::F32_LANES;
        let beside = |pair: &&[usize]| pair[1] == pair[0] + stride * pitch;
        let mut first = 0;
        while first < starts.len() {
            let end = first + 1 + starts[first..].windows(2).take_while(beside).count();
            let row = (first..end, whole);
            let done = match (columns, stride) {
                (3, 1) => self.row::<S, A, 3, 1, 9>(lanes, arithmetic, row),
                (3, 2) => self.row::<S, A, 3, 2, 15>(lanes, arithmetic, row),
                (5, 1) => self.row::<S, A, 5, 1, 11>(lanes, arithmetic, row),
                (5, 2) => self.row::<S, A, 5, 2, 17>(lanes, arithmetic, row),
                _ => first,
            };
            for (pixels, channels) in [(done..end, 0..whole), (first..end, whole..*channels)] {
                self.scattered(lanes, arithmetic, pixels, channels);
            }
            first = end;
        }
    }
}

impl<W: Word> Write<'_, '_, W> {
    /// As many vectors as are whole of pixels whose windows, of `K` columns, lie `STEP` pixels from each other, by
    /// tiles that reach over `COLUMNS` of the source; the first pixel that was left.
    #[inline(always)]
    fn row<S, A, const K: usize, const STEP: usize, const COLUMNS: usize>(
        &mut self,
        lanes: S,
        arithmetic: A,
        (pixels, whole): (Range<usize>, usize),
    ) -> usize
    where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let Range { mut start, end } = pixels;
        while start + SIDE_BY_SIDE <= end {
            let mut channel = 0;
            if S::REGISTER_COUNT >= 32 {
                while channel + 2 * S::F32_LANES <= whole {
                    self.side_by_side::<S, A, K, STEP, COLUMNS, 2>(
                        lanes, arithmetic, start, channel,
                    );
                    channel += 2 * S::F32_LANES;
                }
            }
            while channel < whole {
                self.side_by_side::<S, A, K, STEP, COLUMNS, 1>(lanes, arithmetic, start, channel);
                channel += S::F32_LANES;
            }
            start += SIDE_BY_SIDE;
        }
        start
    }

    /// `NV` vectors of a tile, from a channel on.
    #[inline(always)]
    fn side_by_side<
        S,
        A,
        const K: usize,
        const STEP: usize,
        const COLUMNS: usize,
        const NV: usize,
    >(
        &mut self,
        lanes: S,
        arithmetic: A,
        first: usize,
        channel: usize,
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let sums = self.sums::<S, A, K, STEP, COLUMNS, NV>(lanes, arithmetic, first, channel);
        let columns = (channel, NV * S::F32_LANES);
        let finish = Finish::new(lanes, self.product.epilogue, 0, columns);
        let mut pixels: [usize; SIDE_BY_SIDE] = std::array::from_fn(|i| first + i);
        if self.product.backwards() {
            pixels.reverse();
        }
        self.store::<S, A, SIDE_BY_SIDE, NV, true>(
            lanes, arithmetic, pixels, columns, sums, finish,
        );
    }

    /// The sums of a tile's pixels: backwards, if the window lies so. Each sum runs over the taps in order.
    #[inline(always)]
    fn sums<S, A, const K: usize, const STEP: usize, const COLUMNS: usize, const NV: usize>(
        &self,
        lanes: S,
        arithmetic: A,
        first: usize,
        channel: usize,
    ) -> [[S::f32s; NV]; SIDE_BY_SIDE]
    where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        const { assert!(COLUMNS == (SIDE_BY_SIDE - 1) * STEP + K) };
        let DepthwiseProduct {
            source,
            starts,
            taps,
            pitch,
            weights,
            ..
        } = *self.product;
        let start = starts[first] + W::words(channel);
        let words = W::words(NV * S::F32_LANES);
        let backwards = self.product.backwards();
        let mut sums = [[lanes.splat_f32s(0.0); NV]; SIDE_BY_SIDE];
        let (taps, _) = taps.as_chunks::<K>();
        for (taps, weights_of_row) in taps
            .iter()
            .zip(weights.data.chunks_exact(K * weights.channels))
        {
            let mut held = [[lanes.splat_f32s(0.0); NV]; K];
            for (held, weights) in held
                .iter_mut()
                .zip(weights_of_row.chunks_exact(weights.channels))
            {
                *held = vectors::<S, NV, true>(lanes, &weights[channel..]);
            }
            let row = &source[start + taps[0].min(taps[K - 1])..];
            // All before the first is read: between what can fail, nothing is kept in registers.
            let row: [&[W]; COLUMNS] = std::array::from_fn(|column| {
                let column = if backwards {
                    COLUMNS - 1 - column
                } else {
                    column
                };
                &row[column * pitch..][..words]
            });
            each_row!(COLUMNS, column, {
                let x: [_; NV] = arithmetic.load(lanes, row[column]);
                for (i, sums) in sums.iter_mut().enumerate() {
                    if column >= i * STEP && column - i * STEP < K {
                        for v in 0..NV {
                            sums[v] = lanes.fma(x[v], held[column - i * STEP][v], sums[v]);
                        }
                    }
                }
            });
        }
        sums
    }

    /// Pixels wherever they lie, some of their channels: eight pixels at once where registers suffice.
    #[inline(always)]
    fn scattered<S, A>(
        &mut self,
        lanes: S,
        arithmetic: A,
        pixels: Range<usize>,
        channels: Range<usize>,
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let Range { mut start, end } = pixels;
        if S::REGISTER_COUNT >= 32 {
            while start + 8 <= end {
                self.pixels::<S, A, 8>(lanes, arithmetic, start, channels.clone());
                start += 8;
            }
        }
        while start + 4 <= end {
            self.pixels::<S, A, 4>(lanes, arithmetic, start, channels.clone());
            start += 4;
        }
        for pixel in start..end {
            self.pixels::<S, A, 1>(lanes, arithmetic, pixel, channels.clone());
        }
    }

    /// `H` pixels: two vectors of channels at a time, one, and what is left.
    #[inline(always)]
    fn pixels<S, A, const H: usize>(
        &mut self,
        lanes: S,
        arithmetic: A,
        first: usize,
        channels: Range<usize>,
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let Range {
            start: mut channel,
            end,
        } = channels;
        while channel + 2 * S::F32_LANES <= end {
            self.tile::<S, A, H, 2, true>(lanes, arithmetic, first, channel..end);
            channel += 2 * S::F32_LANES;
        }
        if channel + S::F32_LANES <= end {
            self.tile::<S, A, H, 1, true>(lanes, arithmetic, first, channel..end);
            channel += S::F32_LANES;
        }
        if channel < end {
            self.tile::<S, A, H, 1, false>(lanes, arithmetic, first, channel..end);
        }
    }

    /// `NV` vectors of `H` pixels' channels, the first of some; `WHOLE` where there are as many.
    #[inline(always)]
    fn tile<S, A, const H: usize, const NV: usize, const WHOLE: bool>(
        &mut self,
        lanes: S,
        arithmetic: A,
        first: usize,
        channels: Range<usize>,
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
            ..
        } = *self.product;
        let (channel, count) = (channels.start, channels.len().min(NV * S::F32_LANES));
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
        let columns = (channel, count);
        let finish = Finish::new(lanes, epilogue, 0, columns);
        let pixels = std::array::from_fn(|i| first + i);
        self.store::<S, A, H, NV, WHOLE>(lanes, arithmetic, pixels, columns, sums, finish);
    }

    /// Ends the sums of so many channels, from one on, of `H` pixels, and stores them; `WHOLE` where they fill the
    /// vectors.
    #[inline(always)]
    fn store<S, A, const H: usize, const NV: usize, const WHOLE: bool>(
        &mut self,
        lanes: S,
        arithmetic: A,
        pixels: [usize; H],
        (channel, count): (usize, usize),
        sums: [[S::f32s; NV]; H],
        finish: Finish<S, NV>,
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let (word, words) = (W::words(channel), W::words(count));
        for (pixel, mut ended) in pixels.into_iter().zip(sums) {
            let place = self.places[pixel] - self.origin + word;
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
