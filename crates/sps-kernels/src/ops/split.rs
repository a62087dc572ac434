//! Convolutions of maps of f32 by matrix tiles, which multiply numbers of bf16.
//!
//! A number is the sum of its nearest bf16 and of that nearest to what is left: 16 bits of it. Of the four products of
//! such sums three count; sums are of f32. (Henry, Tang and Heinecke, ARITH 2019.)
//!
//! ```text
//! pixel   | upper of all channels | lower of all channels |
//! tap     upper x upper of weights, lower x upper, upper x lower
//! ```

use half::bf16;

use super::bands::{Threads, for_each_band, on_all_threads};
use super::buffer::Buffer;
use super::conv::ConvShape;
use super::grid::{Grid, Window, pixels};
use super::panels::Panels;
use super::phases::Lattice;
use super::product::{Epilogue, Product};
use super::simd::Level;
use super::tiles::WORDS;
use super::words::{Bf16Pair, Word, rounded};

/// Channels of a tile's row.
const CHANNELS: usize = 2 * WORDS;

/// Pixels that one thread splits at once.
const PIXELS: usize = 512;

/// What of a number its nearest bf16 leaves; nothing of what is not finite.
#[inline(always)]
fn rest(number: f32) -> f32 {
    let rest = number - Bf16Pair::widened(rounded(number));
    if rest.is_nan() { 0.0 } else { rest }
}

/// A convolution of maps of f32, with its weights laid out for tiles.
#[derive(Debug, Clone)]
pub(crate) struct Split {
    level: Level,
    shape: ConvShape,
    /// Of each group.
    panels: Vec<Panels<Bf16Pair>>,
}

impl Split {
    /// Packs weights `(outputs, inputs / groups, time, height, width)`; none where tiles do not multiply them.
    pub(super) fn pack(level: Level, shape: ConvShape, weights: &[f32]) -> Option<Self> {
        if let Some((shape, weights)) = shape.joined::<Bf16Pair>(level, weights) {
            return Self::pack(level, shape, &weights);
        }
        let (inputs, outputs) = (shape.group_inputs(), shape.group_outputs());
        let whole = shape.groups == 1 || inputs.is_multiple_of(CHANNELS);
        if level.tiles().is_none() || shape.depthwise() || !whole {
            return None;
        }
        let taps = pixels(shape.window.size);
        let panels = |group: usize| {
            let runs = [2 * taps, words(inputs)];
            Panels::pack(level, runs, outputs, |run, word, column| {
                let (tap, half) = (run / 2, run % 2);
                let output = group * outputs + column;
                Bf16Pair::gathered(|i| {
                    let input = 2 * word + i;
                    if input >= inputs {
                        return bf16::ZERO;
                    }
                    let weight = weights[(output * inputs + input) * taps + tap];
                    rounded([weight, rest(weight)][half])
                })
            })
        };
        Some(Self {
            level,
            shape,
            panels: (0..shape.groups).map(panels).collect(),
        })
    }

    /// As [`Conv::apply_by`](super::conv::Conv::apply_by).
    pub(super) fn apply(
        &self,
        window: &Window,
        threads: Threads,
        (source, from): (&[f32], &Grid),
        (target, to): (&mut [f32], &Grid),
        epilogue: Epilogue<'_>,
    ) {
        let upper = words(self.shape.inputs);
        let split = Grid {
            before: from.before,
            after: from.after,
            ..Grid::tight(from.frames, from.size, 2 * upper)
        };
        let mut memory = Buffer::<Bf16Pair>::zeros(split.len());
        self.split(threads, (source, from), (&mut memory, split.pitch));
        let taps = split.taps(self.shape.window.size);
        let [inputs, outputs] = [self.shape.group_inputs(), self.shape.group_outputs()];
        for_each_band(threads, to, target, |band| {
            let rows = band.rows(to);
            let reach = Lattice::of_window(window, &split).reach(rows, &split, to);
            for (group, panels) in self.panels.iter().enumerate() {
                let column = group * outputs;
                let product = Product {
                    source: &memory[words(group * inputs)..],
                    rows: &reach.starts,
                    frame_rows: reach.places.len() / band.frames.len().max(1),
                    taps: &taps,
                    run: words(inputs),
                    lower: Some(upper),
                    panels: panels.all(),
                    epilogue: epilogue.from(band.frames.start, column),
                };
                product.write_by_tiles(&mut band.target[column..], &reach.places, band.origin);
            }
        });
    }

    /// Splits all pixels in memory, those of the border among them.
    fn split(
        &self,
        threads: Threads,
        (source, from): (&[f32], &Grid),
        (target, pitch): (&mut [Bf16Pair], usize),
    ) {
        // Words from one pixel of the source to the next, as `pitch` is of the target.
        let (step, channels) = (from.pitch, self.shape.inputs);
        let parts = source.chunks(PIXELS * step);
        let parts = parts.zip(target.chunks_mut(PIXELS * pitch));
        let split = |(source, target): (&[f32], &mut [Bf16Pair])| {
            self.level.run(
                #[inline(always)]
                move || {
                    let pixels = source.chunks(step);
                    for (pixel, target) in pixels.zip(target.chunks_exact_mut(pitch)) {
                        let numbers = Bf16Pair::each_mut(target);
                        let (upper, lower) = numbers.split_at_mut(pitch);
                        let pixel = &pixel[..channels];
                        // One after the other, so that each loop becomes one over vectors.
                        for (upper, number) in upper.iter_mut().zip(pixel) {
                            *upper = rounded(*number);
                        }
                        for (lower, number) in lower.iter_mut().zip(pixel) {
                            *lower = rounded(rest(*number));
                        }
                    }
                },
            );
        };
        match threads {
            Threads::One => parts.for_each(split),
            Threads::All => on_all_threads(parts.collect(), split),
        }
    }
}

/// Words of one half of so many channels.
const fn words(channels: usize) -> usize {
    channels.div_ceil(CHANNELS) * WORDS
}
