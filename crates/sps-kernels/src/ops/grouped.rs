//! Convolution in groups narrower than a vector.
//!
//! A vector holds several groups. Each element of the window is a vector of weights, one for
//! each channel that leaves; against it stands the source with one channel of each group spread
//! over the group.

use sps_base::parallel;

use super::buffer::Buffer;
use super::outer::Pairs;
use super::product::Finish;
use super::rows::{RowWeights, Writer};
use super::simd::{Lanes, Level};
use super::words::{Arithmetic, Real, Word, WordKernel, lanes_of};

/// The weights of a grouped convolution, `group` channels in and out of each group.
#[derive(Debug, Clone)]
pub(crate) struct GroupWeights<W = f32> {
    level: Level,
    group: usize,
    taps: usize,
    /// `(channels / (vectors * lanes), taps, words of a group, vectors, lanes)`, with as many
    /// vectors as a word has numbers
    data: Buffer<W>,
}

impl<W: Word> GroupWeights<W> {
    /// Whether groups of this width are narrow enough for the kernel.
    pub(crate) fn serves(level: Level, channels: usize, group: usize) -> bool {
        let lanes = level.lanes();
        channels.is_multiple_of(W::NUMBERS * lanes)
            && ((group == 4 && lanes >= 4) || (group == 8 && lanes == 16))
    }

    /// Packs weights whose element for channel `out`, tap `tap` and the group's channel `input`
    /// is `element(out, tap, input)`.
    pub(crate) fn pack(
        level: Level,
        channels: usize,
        group: usize,
        taps: usize,
        element: impl Fn(usize, usize, usize) -> W::Number,
    ) -> Self {
        let (lanes, vectors, words) = (level.lanes(), W::NUMBERS, W::words(group));
        let mut data = Buffer::zeros(channels * taps * words);
        for (i, out) in data.iter_mut().enumerate() {
            let (i, lane) = (i / lanes, i % lanes);
            let (i, vector) = (i / vectors, i % vectors);
            let (i, word) = (i / words, i % words);
            let (block, tap) = (i / taps, i % taps);
            let channel = (block * vectors + vector) * lanes + lane;
            *out = W::gathered(|number| element(channel, tap, W::NUMBERS * word + number));
        }
        Self {
            level,
            group,
            taps,
            data,
        }
    }
}

impl<W: Word> RowWeights<W> for GroupWeights<W> {
    fn level(&self) -> Level {
        self.level
    }

    #[inline(always)]
    fn write<S: Lanes, A: Arithmetic<S, Word = W>>(mut writer: Writer<'_, W, Self, S, A>) {
        debug_assert_eq!(writer.rows.taps.len(), writer.weights.taps);
        if const { W::NUMBERS == 1 } {
            writer.groups::<1, 12>();
        } else if const { W::NUMBERS == 2 } {
            writer.groups::<2, 6>();
        } else {
            writer.groups::<4, 4>();
        }
    }
}

impl<W: Word, S: Lanes, A: Arithmetic<S, Word = W>> Writer<'_, W, GroupWeights<W>, S, A> {
    /// All pixels; a vector of words makes `NV` of channels.
    #[inline(always)]
    fn groups<const NV: usize, const TALLEST: usize>(&mut self) {
        if self.weights.group == 4 {
            self.tiles::<4, NV, TALLEST>();
        } else {
            self.tiles::<8, NV, TALLEST>();
        }
    }

    /// All pixels, `TALLEST` at once where there are registers for it.
    #[inline(always)]
    fn tiles<const G: usize, const NV: usize, const TALLEST: usize>(&mut self) {
        let count = self.rows.places.len();
        let mut first = 0;
        if S::REGISTER_COUNT >= 32 {
            while first + TALLEST <= count {
                self.tile::<G, NV, TALLEST>(first);
                first += TALLEST;
            }
        }
        while first + 4 <= count {
            self.tile::<G, NV, 4>(first);
            first += 4;
        }
        for first in first..count {
            self.tile::<G, NV, 1>(first);
        }
    }

    /// `H` pixels, all channels; a vector of words makes `NV` of channels.
    #[inline(always)]
    fn tile<const G: usize, const NV: usize, const H: usize>(&mut self, first: usize) {
        let rows = self.rows;
        let (lanes, arithmetic) = (self.lanes, self.arithmetic);
        let starts: [usize; H] = std::array::from_fn(|i| rows.starts[first + i]);
        let places: [usize; H] = std::array::from_fn(|i| rows.places[first + i] - rows.origin);
        let (all, _) = S::as_simd_f32s(lanes_of(&self.weights.data));
        let (all, _) = all.as_chunks::<G>();
        for (block, weights) in all.chunks_exact(rows.taps.len()).enumerate() {
            let word = block * S::F32_LANES;
            let mut sums = [[lanes.splat_f32s(0.0); NV]; H];
            for (&tap, weights) in rows.taps.iter().zip(weights) {
                let x: [S::f32s; H] = std::array::from_fn(|i| {
                    let from = starts[i] + tap + word;
                    S::as_simd_f32s(lanes_of(&rows.source[from..from + S::F32_LANES])).0[0]
                });
                for (g, &weight) in weights.iter().enumerate() {
                    let (index, v) = (g / NV, g % NV);
                    for i in 0..H {
                        let x = arithmetic.spread::<G>(lanes, x[i], v, index);
                        sums[i][v] = arithmetic.multiply_add(lanes, x, weight, sums[i][v]);
                    }
                }
            }
            let columns = (block * NV * S::F32_LANES, NV * S::F32_LANES);
            let finish = Finish::<S, NV>::new(lanes, rows.epilogue, 0, columns);
            for i in 0..H {
                let from = places[i] + word;
                let out = &mut self.target[from..from + S::F32_LANES];
                finish.store::<A, true, 2>(lanes, arithmetic, sums[i], out);
            }
        }
    }
}

/// Taps whose sums are held in registers together.
const TAPS: usize = 3;

/// Pixels whose products are summed before the sum joins a longer one.
const PIXELS: usize = 4096;

/// Writes the gradient of a grouped convolution's weights, `(channels, group, taps)`, of `group` channels in and out of
/// each group, where [`GroupWeights::serves`] says so of single numbers.
pub(super) fn weight_gradient<W: Real>(
    level: Level,
    group: usize,
    taps: &[usize],
    pairs: Pairs<'_, W>,
    target: &mut [f32],
) {
    let lanes = level.lanes();
    let blocks = target.chunks_mut(lanes * group * taps.len()).enumerate();
    parallel::each(blocks, |(block, target)| {
        let first = W::words(block * lanes);
        let pairs = Pairs {
            source: &pairs.source[first..],
            gradient: &pairs.gradient[first..],
            ..pairs
        };
        let write = WriteOuter {
            group,
            taps,
            pairs,
            target,
        };
        W::run(level, write);
    });
}

struct WriteOuter<'a, W> {
    group: usize,
    taps: &'a [usize],
    pairs: Pairs<'a, W>,
    target: &'a mut [f32],
}

impl<W: Real> WordKernel<W> for WriteOuter<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(mut self, lanes: S, arithmetic: A) {
        self.target.fill(0.0);
        for (part, some) in self.taps.chunks(TAPS).enumerate() {
            let first = part * TAPS;
            match (self.group, some) {
                (4, &[a, b, c]) => self.taps::<S, A, 4, TAPS>(lanes, arithmetic, first, [a, b, c]),
                (_, &[a, b, c]) if S::REGISTER_COUNT >= 32 => {
                    self.taps::<S, A, 8, TAPS>(lanes, arithmetic, first, [a, b, c]);
                }
                (4, some) => {
                    for (first, &tap) in (first..).zip(some) {
                        self.taps::<S, A, 4, 1>(lanes, arithmetic, first, [tap]);
                    }
                }
                (_, some) => {
                    for (first, &tap) in (first..).zip(some) {
                        self.taps::<S, A, 8, 1>(lanes, arithmetic, first, [tap]);
                    }
                }
            }
        }
    }
}

impl<W: Real> WriteOuter<'_, W> {
    /// The part of taps `first..first + T`.
    #[inline(always)]
    fn taps<S: Lanes, A: Arithmetic<S, Word = W>, const G: usize, const T: usize>(
        &mut self,
        lanes: S,
        arithmetic: A,
        first: usize,
        taps: [usize; T],
    ) {
        let (words, count) = (W::words(S::F32_LANES), self.taps.len());
        let pairs = self.pairs;
        let pixels = pairs.starts.chunks(PIXELS).zip(pairs.places.chunks(PIXELS));
        for (starts, places) in pixels {
            let mut sums = [[lanes.splat_f32s(0.0); G]; T];
            for (&start, &place) in starts.iter().zip(places) {
                let [y] = arithmetic.load(lanes, &pairs.gradient[place..place + words]);
                for t in 0..T {
                    let from = start + taps[t];
                    let [x] = arithmetic.load(lanes, &pairs.source[from..from + words]);
                    for (g, sum) in sums[t].iter_mut().enumerate() {
                        *sum = lanes.fma(lanes.spread::<G, 1>(x, 0, g), y, *sum);
                    }
                }
            }
            for (t, sums) in sums.iter().enumerate() {
                for (g, sum) in sums.iter().enumerate() {
                    let sum: &[f32] = bytemuck::cast_slice(std::slice::from_ref(sum));
                    for (lane, sum) in sum.iter().enumerate() {
                        self.target[(lane * G + g) * count + first + t] += sum;
                    }
                }
            }
        }
    }
}
