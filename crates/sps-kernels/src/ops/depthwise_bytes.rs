//! Convolution of each channel by itself, of maps of bytes.
//!
//! Four rows of the window at one column of it, of as many channels as a vector has bytes, become four
//! vectors of which each word holds one channel's four numbers: what the sums of [`Bytes`](super::words::Bytes)
//! take. Pixels that lie side by side share the columns that their windows share.

use std::ops::Range;

use bytemuck::Zeroable;

use super::buffer::Buffer;
use super::product::{Columns, Finish};
use super::rows::{RowWeights, Writer};
use super::simd::{Lanes, Level, channel_of, load};
use super::words::{Arithmetic, Word, lanes_of, vectors};

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

/// As many vectors of weights stay in registers beside the sums.
const HELD: usize = 12;

impl<W: Word> RowWeights<W> for QuadWeights<W> {
    fn level(&self) -> Level {
        self.level
    }

    #[inline(always)]
    fn write<S: Lanes, A: Arithmetic<S, Word = W>>(mut writer: Writer<'_, W, Self, S, A>) {
        let (lanes, weights) = (writer.lanes, writer.weights);
        let (channels, epilogue) = (weights.channels, writer.rows.epilogue);
        let block_len = weights.rows.div_ceil(QUAD) * weights.columns * QUAD * S::F32_LANES;
        // No closure: one that is not inlined is compiled without the instructions.
        let mut blocks = Vec::with_capacity(weights.data.len() / block_len);
        for (block, weights) in weights.data.chunks_exact(block_len).enumerate() {
            let channel = block * QUAD * S::F32_LANES;
            let scale = spread::<S>(lanes, epilogue.scale, channels, channel, 1.0);
            let shift = spread::<S>(lanes, epilogue.shift, channels, channel, 0.0);
            blocks.push(Block {
                weights: S::as_simd_f32s(lanes_of(weights)).0.as_chunks().0,
                word: block * S::F32_LANES,
                words: (W::words(channels) - block * S::F32_LANES).min(S::F32_LANES),
                finish: Finish::of_vectors(lanes, epilogue, scale, shift),
            });
        }
        match (weights.rows, weights.columns, writer.rows.stride) {
            (3, 3, 1) => writer.by_windows::<3, 1>(&blocks),
            (3, 3, 2) => writer.by_windows::<3, 2>(&blocks),
            (5, 5, 1) => writer.by_windows::<5, 1>(&blocks),
            (5, 5, 2) => writer.by_windows::<5, 2>(&blocks),
            _ => {
                for pixel in 0..writer.rows.places.len() {
                    for block in &blocks {
                        writer.pixel(block, pixel);
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

impl<W: Word, S: Lanes, A: Arithmetic<S, Word = W>> Writer<'_, W, QuadWeights<W>, S, A> {
    /// All pixels, by windows of `K x K` that lie `STEP` pixels from each other in a row.
    #[inline(always)]
    fn by_windows<const K: usize, const STEP: usize>(&mut self, blocks: &[Block<'_, S>]) {
        let rows = self.rows;
        for pixels in rows.side_by_side() {
            let last = rows.starts[pixels.end - 1] + rows.taps[rows.taps.len() - 1];
            for block in blocks {
                // What a vector reads beyond the channels is not stored.
                if last + block.word + S::F32_LANES <= rows.source.len() {
                    self.row::<K, STEP, true>(block, pixels.clone());
                } else {
                    self.row::<K, STEP, false>(block, pixels.clone());
                }
            }
        }
    }

    /// Pixels whose windows lie side by side, column by column: each is read once, and joins the sums of the windows
    /// that it is under. `WHOLE` if all of a vector can be read everywhere.
    #[inline(always)]
    fn row<const K: usize, const STEP: usize, const WHOLE: bool>(
        &mut self,
        block: &Block<'_, S>,
        pixels: Range<usize>,
    ) {
        let (lanes, arithmetic) = (self.lanes, self.arithmetic);
        let rows = self.rows;
        let from = rows.starts[pixels.start] + block.word;
        let count = pixels.len();
        let words = if WHOLE { S::F32_LANES } else { block.words };
        let columns = (count - 1) * STEP + K;
        let lines: [&[f32]; K] = std::array::from_fn(|row| {
            let row = &rows.source[from + rows.taps[row * K]..];
            lanes_of(&row[..(columns - 1) * rows.pitch + words])
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
                            let row = &lines[group * QUAD + i][column * rows.pitch..][..words];
                            [x[i]] = vectors::<S, 1, WHOLE>(lanes, row);
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
                self.store(block, pixel, sums[open - 1]);
            }
            for window in (1..open).rev() {
                sums[window] = sums[window - 1];
            }
            sums[0] = [lanes.splat_f32s(0.0); QUAD];
        }
    }

    /// One pixel, by any window.
    #[inline(always)]
    fn pixel(&mut self, block: &Block<'_, S>, pixel: usize) {
        let (lanes, arithmetic) = (self.lanes, self.arithmetic);
        let columns = self.weights.columns;
        let rows = self.rows;
        let from = rows.starts[pixel] + block.word;
        let mut sums = [lanes.splat_f32s(0.0); QUAD];
        let weights = block.weights.chunks_exact(columns);
        for (taps, weights) in rows.taps.chunks(QUAD * columns).zip(weights) {
            for (column, weights) in weights.iter().enumerate() {
                let mut x = [lanes.splat_f32s(0.0); QUAD];
                for (x, tap) in x.iter_mut().zip(taps[column..].iter().step_by(columns)) {
                    *x = load(lanes, lanes_of(&rows.source[from + tap..][..block.words]));
                }
                let x = lanes.interleave(x);
                for v in 0..QUAD {
                    sums[v] = arithmetic.multiply_add(lanes, x[v], weights[v], sums[v]);
                }
            }
        }
        self.store(block, pixel, sums);
    }

    /// Ends a pixel's sums and stores them.
    #[inline(always)]
    fn store(&mut self, block: &Block<'_, S>, pixel: usize, sums: [S::f32s; QUAD]) {
        let lanes = self.lanes;
        let place = self.rows.places[pixel] - self.rows.origin + block.word;
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
            let finish = block.finish;
            ended[v] = finish.apply_some::<A, 2>(lanes, self.arithmetic, v, sum, stored);
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
    let numbers = &of.values[channel..channels];
    let places: &mut [f32] = bytemuck::cast_slice_mut(&mut vectors);
    for (i, place) in places.iter_mut().enumerate() {
        if let Some(number) = numbers.get(channel_of(i / S::F32_LANES, i % S::F32_LANES)) {
            *place = *number;
        }
    }
    vectors
}
