//! Convolution of each channel by itself.
//!
//! Windows that lie side by side share the columns that they share: a tile reads each once.

use std::ops::Range;

use sps_base::parallel;

use super::buffer::Buffer;
use super::outer::Pairs;
use super::product::Finish;
use super::rows::{RowWeights, Writer};
use super::simd::{Lanes, Level, load};
use super::words::{Arithmetic, Real, Word, WordKernel, vectors};

/// The weights of a depth-wise convolution, f32 whatever the feature maps are made of.
#[derive(Debug, Clone)]
pub(crate) struct ChannelWeights {
    level: Level,
    channels: usize,
    /// Taps in a row of the window, which lie side by side one way or the other.
    columns: usize,
    /// `(taps, channels)`
    data: Buffer,
}

impl ChannelWeights {
    /// Packs some taps of weights `(channels, window)`, `columns` of them in each row.
    pub(crate) fn pack(
        level: Level,
        (taps, columns): (&[usize], usize),
        window: usize,
        weights: &[f32],
    ) -> Self {
        let channels = weights.len() / window;
        let mut data = Buffer::zeros(channels * taps.len());
        for (&tap, row) in taps.iter().zip(data.chunks_exact_mut(channels)) {
            for (out, weights) in row.iter_mut().zip(weights.chunks_exact(window)) {
                *out = weights[tap];
            }
        }
        Self {
            level,
            channels,
            columns,
            data,
        }
    }
}

/// Pixels in a row whose sums are held in registers together: a row of the smallest map of an image of 224 pixels, by
/// two vectors of channels.
const SIDE_BY_SIDE: usize = 7;

impl<W: Word> RowWeights<W> for ChannelWeights {
    fn level(&self) -> Level {
        self.level
    }

    #[inline(always)]
    fn write<S: Lanes, A: Arithmetic<S, Word = W>>(writer: Writer<'_, W, Self, S, A>) {
        match (writer.weights.columns, writer.rows.stride) {
            (3, 1) => writer.all_side_by_side::<3, 1, 9>(),
            (3, 2) => writer.all_side_by_side::<3, 2, 15>(),
            (5, 1) => writer.all_side_by_side::<5, 1, 11>(),
            (5, 2) => writer.all_side_by_side::<5, 2, 17>(),
            _ => {
                let pixels = 0..writer.rows.starts.len();
                let channels = 0..writer.weights.channels;
                writer.scattered(pixels, channels);
            }
        }
    }
}

impl<W: Word, S: Lanes, A: Arithmetic<S, Word = W>> Writer<'_, W, ChannelWeights, S, A> {
    /// All pixels of windows of `K` columns, which lie `STEP` pixels from each other in a row, by tiles that reach
    /// over `COLUMNS` of the source where they can.
    #[inline(always)]
    fn all_side_by_side<const K: usize, const STEP: usize, const COLUMNS: usize>(mut self) {
        self.arithmetic.apart(
            self.lanes,
            #[inline(always)]
            move || {
                let channels = self.weights.channels;
                let whole = channels - channels % S::F32_LANES;
                for pixels in self.rows.side_by_side() {
                    let done = self.row::<K, STEP, COLUMNS>((pixels.clone(), whole));
                    self.rest(done..pixels.end, 0..whole);
                    self.rest(pixels, whole..channels);
                }
            },
        );
    }

    /// Some pixels, wherever they lie, and some of their channels: eight pixels at once where registers suffice.
    #[inline(always)]
    fn scattered(mut self, Range { mut start, end }: Range<usize>, channels: Range<usize>) {
        self.arithmetic.apart(
            self.lanes,
            #[inline(always)]
            move || {
                if S::REGISTER_COUNT >= 32 {
                    while start + 8 <= end {
                        self.pixels::<8>(start, channels.clone());
                        start += 8;
                    }
                }
                while start + 4 <= end {
                    self.pixels::<4>(start, channels.clone());
                    start += 4;
                }
                for pixel in start..end {
                    self.pixels::<1>(pixel, channels.clone());
                }
            },
        );
    }

    /// What tiles have left of a row, if anything.
    #[inline(always)]
    fn rest(&mut self, pixels: Range<usize>, channels: Range<usize>) {
        if !pixels.is_empty() && !channels.is_empty() {
            let target = &mut *self.target;
            Writer { target, ..*self }.scattered(pixels, channels);
        }
    }

    /// Whether the pixels in a row of the window lie in the order against that of places.
    #[inline(always)]
    fn backwards(&self) -> bool {
        matches!(self.rows.taps, [first, second, ..] if second < first)
    }

    /// As many vectors as are whole of pixels whose windows, of `K` columns, lie `STEP` pixels from each other, by
    /// tiles that reach over `COLUMNS` of the source; the first pixel that was left.
    #[inline(always)]
    fn row<const K: usize, const STEP: usize, const COLUMNS: usize>(
        &mut self,
        (pixels, whole): (Range<usize>, usize),
    ) -> usize {
        let Range { mut start, end } = pixels;
        while start + SIDE_BY_SIDE <= end {
            let mut channel = 0;
            if S::REGISTER_COUNT >= 32 {
                while channel + 2 * S::F32_LANES <= whole {
                    self.side_by_side::<K, STEP, COLUMNS, 2>(start, channel);
                    channel += 2 * S::F32_LANES;
                }
            }
            while channel < whole {
                self.side_by_side::<K, STEP, COLUMNS, 1>(start, channel);
                channel += S::F32_LANES;
            }
            start += SIDE_BY_SIDE;
        }
        start
    }

    /// `NV` vectors of a tile, from a channel on.
    #[inline(always)]
    fn side_by_side<const K: usize, const STEP: usize, const COLUMNS: usize, const NV: usize>(
        &mut self,
        first: usize,
        channel: usize,
    ) {
        let sums = self.sums::<K, STEP, COLUMNS, NV>(first, channel);
        let mut pixels: [usize; SIDE_BY_SIDE] = std::array::from_fn(|i| first + i);
        if self.backwards() {
            pixels.reverse();
        }
        self.store::<SIDE_BY_SIDE, NV, true>(pixels, (channel, NV * S::F32_LANES), sums);
    }

    /// The sums of a tile's pixels: backwards, if the window lies so. Each sum runs over the taps in order.
    #[inline(always)]
    fn sums<const K: usize, const STEP: usize, const COLUMNS: usize, const NV: usize>(
        &self,
        first: usize,
        channel: usize,
    ) -> [[S::f32s; NV]; SIDE_BY_SIDE] {
        const { assert!(COLUMNS == (SIDE_BY_SIDE - 1) * STEP + K) };
        let rows = self.rows;
        let (lanes, weights) = (self.lanes, self.weights);
        let start = rows.starts[first] + W::words(channel);
        let words = W::words(NV * S::F32_LANES);
        let backwards = self.backwards();
        let mut sums = [[lanes.splat_f32s(0.0); NV]; SIDE_BY_SIDE];
        let (taps, _) = rows.taps.as_chunks::<K>();
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
            let row = &rows.source[start + taps[0].min(taps[K - 1])..];
            // All before the first is read: between what can fail, nothing is kept in registers.
            let row: [&[W]; COLUMNS] = std::array::from_fn(|column| {
                let column = if backwards {
                    COLUMNS - 1 - column
                } else {
                    column
                };
                &row[column * rows.pitch..][..words]
            });
            each_row!(COLUMNS, column, {
                let x: [_; NV] = self.arithmetic.load(lanes, row[column]);
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

    /// `H` pixels: two vectors of channels at a time, one, and what is left.
    #[inline(always)]
    fn pixels<const H: usize>(&mut self, first: usize, channels: Range<usize>) {
        let Range {
            start: mut channel,
            end,
        } = channels;
        while channel + 2 * S::F32_LANES <= end {
            self.tile::<H, 2, true>(first, channel..end);
            channel += 2 * S::F32_LANES;
        }
        if channel + S::F32_LANES <= end {
            self.tile::<H, 1, true>(first, channel..end);
            channel += S::F32_LANES;
        }
        if channel < end {
            self.tile::<H, 1, false>(first, channel..end);
        }
    }

    /// `NV` vectors of `H` pixels' channels, the first of some; `WHOLE` where there are as many.
    #[inline(always)]
    fn tile<const H: usize, const NV: usize, const WHOLE: bool>(
        &mut self,
        first: usize,
        channels: Range<usize>,
    ) {
        let rows = self.rows;
        let (lanes, arithmetic, weights) = (self.lanes, self.arithmetic, self.weights);
        let (channel, count) = (channels.start, channels.len().min(NV * S::F32_LANES));
        let (word, words) = (W::words(channel), W::words(count));
        let starts: [usize; H] = std::array::from_fn(|i| rows.starts[first + i] + word);
        let mut sums = [[lanes.splat_f32s(0.0); NV]; H];
        let weights = weights.data.chunks_exact(weights.channels);
        for (&tap, row) in rows.taps.iter().zip(weights) {
            let weights = vectors::<S, NV, WHOLE>(lanes, &row[channel..channel + count]);
            for i in 0..H {
                let from = starts[i] + tap;
                let x = arithmetic.read::<NV, WHOLE>(lanes, &rows.source[from..from + words]);
                for v in 0..NV {
                    sums[i][v] = lanes.fma(x[v], weights[v], sums[i][v]);
                }
            }
        }
        let pixels = std::array::from_fn(|i| first + i);
        self.store::<H, NV, WHOLE>(pixels, (channel, count), sums);
    }

    /// Ends the sums of so many channels, from one on, of `H` pixels, and stores them; `WHOLE` where they fill the
    /// vectors.
    #[inline(always)]
    fn store<const H: usize, const NV: usize, const WHOLE: bool>(
        &mut self,
        pixels: [usize; H],
        (channel, count): (usize, usize),
        sums: [[S::f32s; NV]; H],
    ) {
        let finish = Finish::new(self.lanes, self.rows.epilogue, 0, (channel, count));
        let (word, words) = (W::words(channel), W::words(count));
        for (pixel, sums) in pixels.into_iter().zip(sums) {
            let place = self.rows.places[pixel] - self.rows.origin + word;
            let out = &mut self.target[place..place + words];
            finish.store::<A, WHOLE, 2>(self.lanes, self.arithmetic, sums, out);
        }
    }
}

/// Pixels whose products are summed before the sum joins a longer one.
const PIXELS: usize = 256;

/// Vectors of channels whose sums are held in registers together.
const VECTORS: usize = 4;

/// Writes the gradient of a depth-wise convolution's weights, `(channels, taps)`.
pub(super) fn weight_gradient<W: Real>(
    level: Level,
    taps: &[usize],
    pairs: Pairs<'_, W>,
    target: &mut [f32],
) {
    let channels = target.len() / taps.len();
    // The channels in parts, too: a window has too few taps for many threads.
    let wanted = (4 * rayon::current_num_threads()).div_ceil(taps.len());
    let step = VECTORS * level.lanes();
    let width = channels.div_ceil(wanted).next_multiple_of(step);
    let firsts = (0..channels).step_by(width);
    let parts = firsts.flat_map(|first| taps.iter().map(move |tap| (first, tap)));
    let sums = parallel::map(parts, |(first, tap)| {
        let (channels, first) = (width.min(channels - first), W::words(first));
        let (source, gradient) = (&pairs.source[tap + first..], &pairs.gradient[first..]);
        let pairs = Pairs {
            source,
            gradient,
            ..pairs
        };
        W::run(level, TapSums { channels, pairs })
    });
    for (part, sums) in sums.iter().enumerate() {
        let (first, tap) = (part / taps.len() * width, part % taps.len());
        let target = target[first * taps.len() + tap..].iter_mut();
        for (target, sum) in target.step_by(taps.len()).zip(sums) {
            *target = *sum;
        }
    }
}

/// The sums of one tap, over the products of each channel's pairs.
struct TapSums<'a, W> {
    channels: usize,
    pairs: Pairs<'a, W>,
}

impl<W: Real> WordKernel<W> for TapSums<'_, W> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(self, lanes: S, arithmetic: A) -> Vec<f32> {
        let mut total = vec![0.0; self.channels];
        let Pairs { starts, places, .. } = self.pairs;
        for (starts, places) in starts.chunks(PIXELS).zip(places.chunks(PIXELS)) {
            let step = VECTORS * S::F32_LANES;
            for (part, total) in total.chunks_mut(step).enumerate() {
                let channel = part * step;
                let pixels = (starts, places);
                if total.len() == step {
                    self.add::<S, A, VECTORS, true>(lanes, arithmetic, pixels, channel, total);
                    continue;
                }
                for (part, total) in total.chunks_mut(S::F32_LANES).enumerate() {
                    let channel = channel + part * S::F32_LANES;
                    self.add::<S, A, 1, false>(lanes, arithmetic, pixels, channel, total);
                }
            }
        }
        total
    }
}

impl<W: Real> TapSums<'_, W> {
    /// Adds the sums over some pixels of the channels from one on; `WHOLE` if they fill the vectors.
    #[inline(always)]
    fn add<S: Lanes, A: Arithmetic<S, Word = W>, const NV: usize, const WHOLE: bool>(
        &self,
        lanes: S,
        arithmetic: A,
        (starts, places): (&[usize], &[usize]),
        channel: usize,
        total: &mut [f32],
    ) {
        let (word, words) = (W::words(channel), W::words(total.len()));
        let mut sums = [lanes.splat_f32s(0.0); NV];
        for (&start, &place) in starts.iter().zip(places) {
            let x = &self.pairs.source[start + word..][..words];
            let x = arithmetic.read::<NV, WHOLE>(lanes, x);
            let y = &self.pairs.gradient[place + word..][..words];
            let y = arithmetic.read::<NV, WHOLE>(lanes, y);
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
