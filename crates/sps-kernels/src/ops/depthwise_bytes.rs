//! Convolution of each channel by itself, of maps of bytes.
//!
//! Four rows of the window at one column of it, of as many channels as a vector has bytes, become four
//! vectors of which each word holds one channel's four numbers: what the sums of [`Bytes`](super::words::Bytes)
//! take. Pixels that lie side by side share the columns that their windows share.

use std::ops::Range;

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

/// As many vectors of weights stay in registers beside the sums.
const HELD: usize = 12;

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
        let QuadProduct {
            stride,
            epilogue,
            weights:
                QuadWeights {
                    channels,
                    rows,
                    columns,
                    data,
                    ..
                },
            ..
        } = *self.product;
        let block_len = rows.div_ceil(QUAD) * columns * QUAD * S::F32_LANES;
        // No closure: one that is not inlined is compiled without the instructions.
        let mut blocks = Vec::with_capacity(data.len() / block_len);
        for (block, weights) in data.chunks_exact(block_len).enumerate() {
            let channel = block * QUAD * S::F32_LANES;
            let scale = spread::<S>(lanes, epilogue.scale, *channels, channel, 1.0);
            let shift = spread::<S>(lanes, epilogue.shift, *channels, channel, 0.0);
            blocks.push(Block {
                weights: S::as_simd_f32s(lanes_of(weights)).0.as_chunks().0,
                word: block * S::F32_LANES,
                words: (W::words(*channels) - block * S::F32_LANES).min(S::F32_LANES),
                finish: Finish::of_vectors(lanes, epilogue, scale, shift),
            });
        }
        match (rows, columns, stride) {
            (3, 3, 1) => self.rows::<S, A, 3, 1>(lanes, arithmetic, &blocks),
            (3, 3, 2) => self.rows::<S, A, 3, 2>(lanes, arithmetic, &blocks),
            (5, 5, 1) => self.rows::<S, A, 5, 1>(lanes, arithmetic, &blocks),
            (5, 5, 2) => self.rows::<S, A, 5, 2>(lanes, arithmetic, &blocks),
            _ => {
                for pixel in 0..self.places.len() {
                    for block in &blocks {
                        self.pixel::<S, A>(lanes, arithmetic, block, pixel);
                    }
                }
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
    /// All pixels, by windows of `K x K` that lie `STEP` pixels from each other in a row.
    #[inline(always)]
    fn rows<S, A, const K: usize, const STEP: usize>(
        &mut self,
        lanes: S,
        arithmetic: A,
        blocks: &[Block<'_, S>],
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let QuadProduct {
            source,
            starts,
            taps,
            pitch,
            ..
        } = *self.product;
        let beside = |pair: &&[usize]| pair[1] == pair[0] + STEP * pitch;
        let mut first = 0;
        while first < starts.len() {
            let end = first + 1 + starts[first..].windows(2).take_while(beside).count();
            let last = starts[end - 1] + taps[taps.len() - 1];
            for block in blocks {
                // What a vector reads beyond the channels is not stored.
                if last + block.word + S::F32_LANES <= source.len() {
                    self.row::<S, A, K, STEP, true>(lanes, arithmetic, block, first..end);
                } else {
                    self.row::<S, A, K, STEP, false>(lanes, arithmetic, block, first..end);
                }
            }
            first = end;
        }
    }

    /// Pixels whose windows lie side by side, column by column: each is read once, and joins the sums of the windows
    /// that it is under. `WHOLE` if all of a vector can be read everywhere.
    #[inline(always)]
    fn row<S, A, const K: usize, const STEP: usize, const WHOLE: bool>(
        &mut self,
        lanes: S,
        arithmetic: A,
        block: &Block<'_, S>,
        pixels: Range<usize>,
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let QuadProduct {
            source,
            starts,
            taps,
            pitch,
            ..
        } = *self.product;
        let from = starts[pixels.start] + block.word;
        let count = pixels.len();
        let words = if WHOLE { S::F32_LANES } else { block.words };
        let columns = (count - 1) * STEP + K;
        let rows: [&[f32]; K] = std::array::from_fn(|row| {
            let row = &source[from + taps[row * K]..];
            lanes_of(&row[..(columns - 1) * pitch + words])
        });
        let (weights, _) = block.weights.as_chunks::<K>();
        let weights = &weights[..const { K.div_ceil(QUAD) }];
        let mut held = [[[lanes.splat_f32s(0.0); QUAD]; K]; K];
        if const { K.div_ceil(QUAD) * K * QUAD <= HELD } {
            held[..weights.len()].copy_from_slice(weights);
        }
        let open = const { K.div_ceil(STEP) };
        // Of the windows that a column is under: the youngest first, which begins `STEP` columns behind the next.
        let mut sums = [[lanes.splat_f32s(0.0); QUAD]; K];
        for step in 0..count + open - 1 {
            for beside in 0..STEP {
                let column = step * STEP + beside;
                if column >= columns {
                    break;
                }
                for group in 0..const { K.div_ceil(QUAD) } {
                    let mut x = [lanes.splat_f32s(0.0); QUAD];
                    for i in 0..QUAD {
                        // Beyond the last row stands nothing.
                        if group * QUAD + i < K {
                            let row =
                                &rows[group * QUAD + i][column * pitch..column * pitch + words];
                            x[i] = if WHOLE {
                                S::as_simd_f32s(row).0[0]
                            } else {
                                lanes.partial_load_f32s(row)
                            };
                        }
                    }
                    let x = lanes.interleave(x);
                    for (window, sums) in sums[..open].iter_mut().enumerate() {
                        let tap = window * STEP + beside;
                        if tap < K {
                            for v in 0..QUAD {
                                let weight = if const { K.div_ceil(QUAD) * K * QUAD <= HELD } {
                                    held[group][tap][v]
                                } else {
                                    weights[group][tap][v]
                                };
                                sums[v] = arithmetic.multiply_add(lanes, x[v], weight, sums[v]);
                            }
                        }
                    }
                }
            }
            if step + 1 >= open {
                let pixel = pixels.start + step + 1 - open;
                self.store::<S, A>(lanes, arithmetic, block, pixel, sums[open - 1]);
            }
            for window in (1..open).rev() {
                sums[window] = sums[window - 1];
            }
            sums[0] = [lanes.splat_f32s(0.0); QUAD];
        }
    }

    /// One pixel, by any window.
    #[inline(always)]
    fn pixel<S, A>(&mut self, lanes: S, arithmetic: A, block: &Block<'_, S>, pixel: usize)
    where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let QuadProduct {
            source,
            taps,
            starts,
            weights,
            ..
        } = *self.product;
        let from = starts[pixel] + block.word;
        let columns = weights.columns;
        let mut sums = [lanes.splat_f32s(0.0); QUAD];
        let groups = taps
            .chunks(QUAD * columns)
            .zip(block.weights.chunks_exact(columns));
        for (taps, weights) in groups {
            for (column, weights) in weights.iter().enumerate() {
                let mut x = [lanes.splat_f32s(0.0); QUAD];
                for (x, tap) in x.iter_mut().zip(taps[column..].iter().step_by(columns)) {
                    *x = load(lanes, lanes_of(&source[from + tap..][..block.words]));
                }
                let x = lanes.interleave(x);
                for v in 0..QUAD {
                    sums[v] = arithmetic.multiply_add(lanes, x[v], weights[v], sums[v]);
                }
            }
        }
        self.store::<S, A>(lanes, arithmetic, block, pixel, sums);
    }

    /// Ends a pixel's sums and stores them.
    #[inline(always)]
    fn store<S, A>(
        &mut self,
        lanes: S,
        arithmetic: A,
        block: &Block<'_, S>,
        pixel: usize,
        sums: [S::f32s; QUAD],
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let place = self.places[pixel] - self.origin + block.word;
        let out: &mut [f32] = bytemuck::cast_slice_mut(&mut self.target[place..][..block.words]);
        let mut stored = [lanes.splat_f32s(0.0); QUAD];
        if block.finish.accumulate {
            stored[0] = load(lanes, out);
            stored = lanes.interleave(stored);
        }
        let mut ended = sums;
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
    }
}

/// The numbers of as many columns, from `channel` on, in the order of a block's sums.
#[inline(always)]
fn spread<S: Lanes>(
    lanes: S,
    of: Option<Columns<'_>>,
    channels: usize,
    channel: usize,
    default: f32,
) -> [S::f32s; QUAD] {
    let mut vectors = [lanes.splat_f32s(default); QUAD];
    let Some(of) = of else { return vectors };
    let numbers = &of.get(0, 0)[channel..channels];
    let places: &mut [f32] = bytemuck::cast_slice_mut(&mut vectors);
    for (i, place) in places.iter_mut().enumerate() {
        if let Some(number) = numbers.get(channel_of(i / S::F32_LANES, i % S::F32_LANES)) {
            *place = *number;
        }
    }
    vectors
}
