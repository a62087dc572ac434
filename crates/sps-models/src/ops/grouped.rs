//! Convolution in groups narrower than a vector.
//!
//! A vector holds several groups. Each element of the window is a vector of weights, one for
//! each channel that leaves; against it stands the source with one channel of each group spread
//! over the group.

use rayon::prelude::*;

use super::buffer::Buffer;
use super::format::{Format, WordKernel, Words, pair};
use super::product::Epilogue;
use super::simd::{Kernel, Lanes, Level};

/// The weights of a grouped convolution, `group` channels in and out of each group.
#[derive(Debug, Clone)]
pub(crate) struct GroupWeights {
    level: Level,
    format: Format,
    group: usize,
    taps: usize,
    /// `(channels / (vectors * lanes), taps, words of a group, vectors, lanes)`, with as many
    /// vectors as a word has numbers
    data: Buffer,
}

impl GroupWeights {
    /// Whether groups of this width are narrow enough for the kernel.
    pub(crate) fn serves(level: Level, format: Format, channels: usize, group: usize) -> bool {
        let lanes = level.lanes();
        channels.is_multiple_of(format.numbers() * lanes)
            && ((group == 4 && lanes >= 4) || (group == 8 && lanes == 16))
    }

    /// Packs weights whose element for channel `out`, tap `tap` and the group's channel `input`
    /// is `element(out, tap, input)`.
    pub(crate) fn pack(
        level: Level,
        format: Format,
        channels: usize,
        group: usize,
        taps: usize,
        element: impl Fn(usize, usize, usize) -> f32,
    ) -> Self {
        let (lanes, vectors) = (level.lanes(), format.numbers());
        let mut data = Buffer::zeros(channels * taps * format.words(group));
        for (i, out) in data.iter_mut().enumerate() {
            let (i, lane) = (i / lanes, i % lanes);
            let (i, vector) = (i / vectors, i % vectors);
            let (i, word) = (i / format.words(group), i % format.words(group));
            let (block, tap) = (i / taps, i % taps);
            let channel = (block * vectors + vector) * lanes + lane;
            *out = match format {
                Format::F32 => element(channel, tap, word),
                Format::Bf16 => pair(
                    element(channel, tap, 2 * word),
                    element(channel, tap, 2 * word + 1),
                ),
            };
        }
        Self {
            level,
            format,
            group,
            taps,
            data,
        }
    }
}

/// A grouped convolution over a source that has its padding around it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GroupedProduct<'a> {
    pub(crate) source: &'a [f32],
    /// Where the window begins for each pixel.
    pub(crate) starts: &'a [u32],
    /// How far from there its pixels lie.
    pub(crate) taps: &'a [u32],
    pub(crate) weights: &'a GroupWeights,
    /// What happens to the sums; factors are not applied, and shifts are those of frame 0.
    pub(crate) epilogue: Epilogue<'a>,
}

impl GroupedProduct<'_> {
    /// Writes pixel `i` at `places[i] - origin` of the target.
    pub(crate) fn write(&self, target: &mut [f32], places: &[u32], origin: usize) {
        debug_assert_eq!(self.taps.len(), self.weights.taps);
        let GroupWeights { level, format, .. } = *self.weights;
        level.run_on(
            format,
            Write {
                product: self,
                target,
                places,
                origin,
            },
        );
    }
}

struct Write<'a, 'b> {
    product: &'a GroupedProduct<'b>,
    target: &'a mut [f32],
    places: &'a [u32],
    origin: usize,
}

impl WordKernel for Write<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, W: Words<S>>(mut self, lanes: S, words: W) {
        match (W::FORMAT, self.product.weights.group) {
            (Format::F32, 4) => self.tiles::<S, W, 4, 1, 12>(lanes, words),
            (Format::F32, _) => self.tiles::<S, W, 8, 1, 12>(lanes, words),
            (Format::Bf16, 4) => self.tiles::<S, W, 4, 2, 6>(lanes, words),
            (Format::Bf16, _) => self.tiles::<S, W, 8, 2, 6>(lanes, words),
        }
    }
}

impl Write<'_, '_> {
    /// All pixels, `TALLEST` at once where there are registers for it.
    #[inline(always)]
    fn tiles<S, W, const G: usize, const NV: usize, const TALLEST: usize>(
        &mut self,
        lanes: S,
        words: W,
    ) where
        S: Lanes,
        W: Words<S>,
    {
        let count = self.places.len();
        let mut first = 0;
        if S::REGISTER_COUNT >= 32 {
            while first + TALLEST <= count {
                self.tile::<S, W, G, NV, TALLEST>(lanes, words, first);
                first += TALLEST;
            }
        }
        while first + 4 <= count {
            self.tile::<S, W, G, NV, 4>(lanes, words, first);
            first += 4;
        }
        for first in first..count {
            self.tile::<S, W, G, NV, 1>(lanes, words, first);
        }
    }

    /// `H` pixels, all channels; a vector of words makes `NV` of channels.
    #[inline(always)]
    fn tile<S, W, const G: usize, const NV: usize, const H: usize>(
        &mut self,
        lanes: S,
        words: W,
        first: usize,
    ) where
        S: Lanes,
        W: Words<S>,
    {
        let GroupedProduct {
            source,
            starts,
            taps,
            weights,
            epilogue,
        } = *self.product;
        let floor = lanes.splat_f32s(epilogue.floor());
        let starts: [usize; H] = std::array::from_fn(|i| starts[first + i] as usize);
        let places: [usize; H] =
            std::array::from_fn(|i| self.places[first + i] as usize - self.origin);
        let (all, _) = S::as_simd_f32s(&weights.data);
        let (all, _) = all.as_chunks::<G>();
        for (block, weights) in all.chunks_exact(taps.len()).enumerate() {
            let word = block * S::F32_LANES;
            let mut sums = [[lanes.splat_f32s(0.0); NV]; H];
            for (&tap, weights) in taps.iter().zip(weights) {
                let x: [S::f32s; H] = std::array::from_fn(|i| {
                    let from = starts[i] + tap as usize + word;
                    vector(lanes, &source[from..from + S::F32_LANES])
                });
                for (g, &weight) in weights.iter().enumerate() {
                    let (index, v) = (g / NV, g % NV);
                    for i in 0..H {
                        let x = words.spread::<G>(lanes, x[i], v, index);
                        sums[i][v] = words.multiply_add(lanes, x, weight, sums[i][v]);
                    }
                }
            }
            let shifts: [S::f32s; NV] = std::array::from_fn(|v| match epilogue.shift {
                Some(shift) => vector(lanes, shift.get(0, (block * NV + v) * S::F32_LANES)),
                None => lanes.splat_f32s(0.0),
            });
            for i in 0..H {
                let from = places[i] + word;
                let out = &mut self.target[from..from + S::F32_LANES];
                let stored: [S::f32s; NV] = if epilogue.accumulate {
                    words.load(lanes, out)
                } else {
                    [lanes.splat_f32s(0.0); NV]
                };
                let sums = std::array::from_fn(|v| {
                    let sum = lanes.add_f32s(sums[i][v], shifts[v]);
                    lanes.at_least(floor, lanes.add_f32s(sum, stored[v]))
                });
                words.store::<NV>(lanes, sums, out);
            }
        }
    }
}

#[inline(always)]
fn vector<S: Lanes>(_lanes: S, from: &[f32]) -> S::f32s {
    S::as_simd_f32s(from).0[0]
}

/// The gradient of a grouped convolution's weights.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GroupedOuter<'a> {
    level: Level,
    channels: usize,
    group: usize,
    taps: &'a [u32],
}

/// Taps whose sums are held in registers together.
const TAPS: usize = 3;

/// Pixels whose products are summed before the sum joins a longer one.
const PIXELS: usize = 4096;

impl<'a> GroupedOuter<'a> {
    /// For groups of `group` channels in and out, where the kernel serves.
    pub(crate) fn new(
        level: Level,
        channels: usize,
        group: usize,
        taps: &'a [u32],
    ) -> Option<Self> {
        GroupWeights::serves(level, Format::F32, channels, group).then_some(Self {
            level,
            channels,
            group,
            taps,
        })
    }

    /// Writes `(channels, group, taps)`: sums over pixels of the source, from `starts` on, times
    /// the gradient at `places`.
    pub(crate) fn write(
        &self,
        source: &[f32],
        starts: &[u32],
        gradient: &[f32],
        places: &[u32],
        target: &mut [f32],
    ) {
        let lanes = self.level.lanes();
        let block_len = lanes * self.group * self.taps.len();
        debug_assert_eq!(target.len(), self.channels * self.group * self.taps.len());
        target
            .par_chunks_exact_mut(block_len)
            .enumerate()
            .for_each(|(block, target)| {
                self.level.run(WriteOuter {
                    outer: self,
                    source: &source[block * lanes..],
                    starts,
                    gradient: &gradient[block * lanes..],
                    places,
                    target,
                });
            });
    }
}

struct WriteOuter<'a, 'b> {
    outer: &'a GroupedOuter<'b>,
    source: &'a [f32],
    starts: &'a [u32],
    gradient: &'a [f32],
    places: &'a [u32],
    target: &'a mut [f32],
}

impl Kernel for WriteOuter<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(mut self, lanes: S) {
        let taps = self.outer.taps;
        self.target.fill(0.0);
        for first in (0..taps.len()).step_by(TAPS) {
            let some = &taps[first..(first + TAPS).min(taps.len())];
            match (self.outer.group, some) {
                (4, &[a, b, c]) => self.taps::<S, 4, TAPS>(lanes, first, [a, b, c]),
                (_, &[a, b, c]) if S::REGISTER_COUNT >= 32 => {
                    self.taps::<S, 8, TAPS>(lanes, first, [a, b, c]);
                }
                (4, some) => {
                    for (i, &tap) in some.iter().enumerate() {
                        self.taps::<S, 4, 1>(lanes, first + i, [tap]);
                    }
                }
                (_, some) => {
                    for (i, &tap) in some.iter().enumerate() {
                        self.taps::<S, 8, 1>(lanes, first + i, [tap]);
                    }
                }
            }
        }
    }
}

impl WriteOuter<'_, '_> {
    /// The part of taps `first..first + T`.
    #[inline(always)]
    fn taps<S: Lanes, const G: usize, const T: usize>(
        &mut self,
        lanes: S,
        first: usize,
        taps: [u32; T],
    ) {
        let pixels = self.starts.chunks(PIXELS).zip(self.places.chunks(PIXELS));
        for (starts, places) in pixels {
            let mut sums = [[lanes.splat_f32s(0.0); G]; T];
            for (&start, &place) in starts.iter().zip(places) {
                let place = place as usize;
                let y = vector(lanes, &self.gradient[place..place + S::F32_LANES]);
                for t in 0..T {
                    let from = (start + taps[t]) as usize;
                    let x = vector(lanes, &self.source[from..from + S::F32_LANES]);
                    for (g, sum) in sums[t].iter_mut().enumerate() {
                        *sum = lanes.fma(lanes.spread::<G>(x, g), y, *sum);
                    }
                }
            }
            let count = self.outer.taps.len();
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
