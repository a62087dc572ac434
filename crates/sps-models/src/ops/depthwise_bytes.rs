//! Convolution of each channel by itself, of maps of bytes.
//!
//! Four rows of the window at one column of it, of as many channels as a vector has bytes, become four
//! vectors of which each word holds one channel's four numbers: what the sums of [`Bytes`](super::words::Bytes)
//! take. Pixels that lie side by side share the columns that their windows share.

use bytemuck::Zeroable;

use super::buffer::Buffer;
use super::product::{Columns, Epilogue, Finish};
use super::simd::{Lanes, Level, channel_of, load};
use super::words::{Arithmetic, Word, WordKernel, lanes_of};

/// Numbers of a word, and vectors that those of one vector are spread over.
const QUAD: usize = 4;

/// The weights of a depth-wise convolution.
#[derive(Debug, Clone)]
pub(crate) struct QuadWeights<W> {
    level: Level,
    channels: usize,
    /// Rows and columns of the window; those of all times are rows below each other.
    rows: usize,
    columns: usize,
    /// `(channels / (4 * lanes), rows / 4, columns, 4, lanes)`, both quotients rounded up: words of four
    /// rows' weights. What is beyond the channels and the rows is 0.
    data: Buffer<W>,
}

impl<W: Word> QuadWeights<W> {
    /// Packs weights `(channels, rows, columns)`.
    pub(crate) fn pack(level: Level, [rows, columns]: [usize; 2], weights: &[f32]) -> Self {
        let (lanes, taps) = (level.lanes(), rows * columns);
        let (channels, groups) = (weights.len() / taps, rows.div_ceil(QUAD));
        let blocks = channels.div_ceil(QUAD * lanes);
        let numbers = W::of_weights(level, weights);
        let numbers = W::each(&numbers);
        let mut data = Buffer::zeros(blocks * groups * columns * QUAD * lanes);
        for (i, out) in data.iter_mut().enumerate() {
            let (i, lane) = (i / lanes, i % lanes);
            let (i, vector) = (i / QUAD, i % QUAD);
            let (i, column) = (i / columns, i % columns);
            let (block, group) = (i / groups, i % groups);
            let channel = block * QUAD * lanes + channel_of(vector, lane);
            *out = W::gathered(|number| {
                let row = group * QUAD + number;
                if row < rows && channel < channels {
                    numbers[channel * taps + row * columns + column]
                } else {
                    W::Number::zeroed()
                }
            });
        }
        Self {
            level,
            channels,
            rows,
            columns,
            data,
        }
    }
}

/// A depth-wise convolution over a source that has its padding around it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct QuadProduct<'a, W> {
    pub(crate) source: &'a [W],
    /// Where the window begins for each pixel.
    pub(crate) starts: &'a [usize],
    /// How far from there its pixels lie.
    pub(crate) taps: &'a [usize],
    /// Words from one pixel of the source to the next.
    pub(crate) pitch: usize,
    /// Pixels from one place of the window to the next in a row.
    pub(crate) stride: usize,
    pub(crate) weights: &'a QuadWeights<W>,
    /// What happens to the sums; factors and shifts are those of frame 0.
    pub(crate) epilogue: Epilogue<'a>,
}

impl<W: Word> QuadProduct<'_, W> {
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
    product: &'a QuadProduct<'b, W>,
    target: &'a mut [W],
    places: &'a [usize],
    origin: usize,
}

impl<W: Word> WordKernel<W> for Write<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(mut self, lanes: S, arithmetic: A) {
        let QuadWeights {
            channels,
            rows,
            columns,
            ref data,
            ..
        } = *self.product.weights;
        let epilogue = self.product.epilogue;
        let block_len = rows.div_ceil(QUAD) * columns * QUAD * S::F32_LANES;
        for (block, weights) in data.chunks_exact(block_len).enumerate() {
            let channel = block * QUAD * S::F32_LANES;
            let spread = |of: Option<Columns<'_>>, default: f32| {
                let of = of.map(|of| &of.get(0, 0)[..channels]);
                spread::<S>(lanes, of, channel, default)
            };
            let block = Block {
                weights: S::as_simd_f32s(lanes_of(weights)).0.as_chunks().0,
                word: block * S::F32_LANES,
                words: (W::words(channels) - block * S::F32_LANES).min(S::F32_LANES),
                finish: Finish::of_vectors(
                    lanes,
                    epilogue,
                    spread(epilogue.scale, 1.0),
                    spread(epilogue.shift, 0.0),
                ),
            };
            let mut first = 0;
            while first < self.places.len() {
                first += if self.beside(first, 4) {
                    self.tile::<S, A, 4>(lanes, arithmetic, &block, first)
                } else if self.beside(first, 2) {
                    self.tile::<S, A, 2>(lanes, arithmetic, &block, first)
                } else {
                    self.tile::<S, A, 1>(lanes, arithmetic, &block, first)
                };
            }
        }
    }
}

/// Channels as wide as a vector of bytes.
struct Block<'a, S: Lanes> {
    /// `(rows / 4, columns)`
    weights: &'a [[S::f32s; QUAD]],
    /// The first word of a pixel, and how many.
    word: usize,
    words: usize,
    finish: Finish<S, QUAD>,
}

impl<W: Word> Write<'_, '_, W> {
    /// Whether so many windows from one on lie in steps of the stride.
    #[inline(always)]
    fn beside(&self, first: usize, count: usize) -> bool {
        let QuadProduct {
            starts,
            pitch,
            stride,
            ..
        } = *self.product;
        let last = first + count - 1;
        last < starts.len() && starts[last] == starts[first] + (count - 1) * stride * pitch
    }

    /// The sums of `H` pixels' windows, the first from `from` on; `WHOLE` if all of a vector can be read
    /// everywhere.
    #[inline(always)]
    fn sums<S, A, const H: usize, const WHOLE: bool>(
        &self,
        lanes: S,
        arithmetic: A,
        block: &Block<'_, S>,
        from: usize,
    ) -> [[S::f32s; QUAD]; H]
    where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let QuadProduct {
            source,
            taps,
            pitch,
            stride,
            weights,
            ..
        } = *self.product;
        let (rows, columns) = (weights.rows, weights.columns);
        let words = if WHOLE { S::F32_LANES } else { block.words };
        let count = (H - 1) * stride + columns;
        let mut sums = [[lanes.splat_f32s(0.0); QUAD]; H];
        for (group, weights) in block.weights.chunks_exact(columns).enumerate() {
            let row = |i: usize| {
                // Beyond the last row, whose weights are 0, stands any.
                let tap = taps[(group * QUAD + i).min(rows - 1) * columns];
                &lanes_of(&source[from + tap..])[..(count - 1) * pitch + words]
            };
            let of_group = [row(0), row(1), row(2), row(3)];
            for column in 0..count {
                let at = column * pitch;
                let mut quad = [lanes.splat_f32s(0.0); QUAD];
                for (quad, row) in quad.iter_mut().zip(of_group) {
                    *quad = load(lanes, &row[at..at + words]);
                }
                let quad = lanes.interleave(quad);
                each_row!(H, i, {
                    // The window of pixel `i` begins so many columns later.
                    if let Some(weights) = weights.get(column.wrapping_sub(i * stride)) {
                        for v in 0..QUAD {
                            let sum = sums[i][v];
                            sums[i][v] = arithmetic.multiply_add(lanes, quad[v], weights[v], sum);
                        }
                    }
                });
            }
        }
        sums
    }

    /// `H` pixels, one beside the other; returns how many.
    #[inline(always)]
    fn tile<S, A, const H: usize>(
        &mut self,
        lanes: S,
        arithmetic: A,
        block: &Block<'_, S>,
        first: usize,
    ) -> usize
    where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let product = self.product;
        let (rows, columns) = (product.weights.rows, product.weights.columns);
        let from = product.starts[first] + block.word;
        let last =
            from + product.taps[rows * columns - 1] + (H - 1) * product.stride * product.pitch;
        // What a vector reads beyond the channels has weights of 0.
        let sums = if last + S::F32_LANES <= product.source.len() {
            self.sums::<S, A, H, true>(lanes, arithmetic, block, from)
        } else {
            self.sums::<S, A, H, false>(lanes, arithmetic, block, from)
        };
        each_row!(H, i, {
            let place = self.places[first + i] - self.origin + block.word;
            let out: &mut [f32] =
                bytemuck::cast_slice_mut(&mut self.target[place..][..block.words]);
            let mut stored = [lanes.splat_f32s(0.0); QUAD];
            if block.finish.accumulate {
                stored[0] = load(lanes, out);
                stored = lanes.interleave(stored);
            }
            let mut ended = sums[i];
            for v in 0..QUAD {
                let sum = lanes.of_integers(ended[v]);
                let stored = lanes.of_integers(stored[v]);
                ended[v] = block.finish.apply_to(lanes, arithmetic, v, sum, stored);
            }
            let ended = lanes.join(ended);
            match S::as_mut_simd_f32s(out).0 {
                [whole, ..] => *whole = ended,
                [] => lanes.partial_store_f32s(out, ended),
            }
        });
        H
    }
}

/// The numbers of a block's channels, from `channel` on, in the order of the sums.
#[inline(always)]
fn spread<S: Lanes>(
    lanes: S,
    numbers: Option<&[f32]>,
    channel: usize,
    default: f32,
) -> [S::f32s; QUAD] {
    let mut vectors = [lanes.splat_f32s(default); QUAD];
    let own = |i: usize| {
        let at = channel + channel_of(i / S::F32_LANES, i % S::F32_LANES);
        numbers.and_then(|numbers| numbers.get(at))
    };
    let places: &mut [f32] = bytemuck::cast_slice_mut(&mut vectors);
    for (i, place) in places.iter_mut().enumerate() {
        *place = own(i).copied().unwrap_or(default);
    }
    vectors
}
