//! Convolutions of images and maps of f32 by matrix tiles, which multiply numbers of bf16.
//!
//! A number is the sum of its nearest bf16 and of that nearest to what is left: 16 bits of it. Of the four products of
//! such sums three count; sums are of f32. (Henry, Tang and Heinecke, ARITH 2019.)
//!
//! ```text
//! pixel, or row of an image   | upper of all numbers | lower of all numbers |
//! tap                         lower x upper of weights, upper x upper, upper x lower
//! ```

use half::bf16;

use super::bands::{Band, Threads, for_each_band, on_all_threads};
use super::buffer::Buffer;
use super::conv::ConvShape;
use super::grid::{Grid, Window, pixels, starts};
use super::image::{self, Phase, rows_of_words};
use super::panels::Panels;
use super::phases::Lattice;
use super::product::{CACHE, Epilogue, Product};
use super::simd::{Lanes, Level};
use super::tiles::{HEIGHT, WORDS, compiled, deepest};
use super::words::{Arithmetic, Bf16Pair, Word, WordKernel, rounded, vectors};

/// Channels of a tile's row.
const CHANNELS: usize = 2 * WORDS;

/// Words of halves that one thread makes at once, and pixels at least, since the weights are read anew for so many.
const NEAR: usize = CACHE / 4;
const PIXELS: usize = 10 * HEIGHT;

/// The upper half of a number or the lower one, which is 0 where the number is not finite.
fn half(number: f32, lower: bool) -> bf16 {
    let upper = rounded(number);
    if !lower {
        return upper;
    }
    let rest = number - Bf16Pair::widened(upper);
    rounded(if rest.is_nan() { 0.0 } else { rest })
}

/// A convolution of images or maps of f32, with its weights laid out for tiles.
#[derive(Debug, Clone)]
pub(crate) struct Split {
    level: Level,
    pub(super) shape: ConvShape,
    weights: Weights,
}

#[derive(Debug, Clone)]
enum Weights {
    /// Of each group.
    Maps(Vec<Panels<Bf16Pair>>),
    Images(Vec<(Phase, Panels<Bf16Pair>)>),
}

/// Both halves of a map or of images in memory, and where a window's runs begin.
struct Halves<'a> {
    memory: &'a [Bf16Pair],
    grid: Grid,
    taps: Vec<usize>,
    /// How far behind the upper half of a run the lower one lies.
    lower: usize,
}

/// Columns of the output from `column` on, at the pixels of a lattice: sums over the source's halves from `word` on.
struct Part<'a> {
    lattice: Lattice,
    word: usize,
    column: usize,
    panels: &'a Panels<Bf16Pair>,
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
                let output = group * outputs + column;
                Bf16Pair::gathered(|i| {
                    let input = 2 * word + i;
                    if input >= inputs {
                        return bf16::ZERO;
                    }
                    let weight = (output * inputs + input) * taps + run / 2;
                    half(weights[weight], run % 2 == 1)
                })
            })
        };
        Some(Self {
            level,
            shape,
            weights: Weights::Maps((0..shape.groups).map(panels).collect()),
        })
    }

    /// The same of weights `(outputs, 3, time, height, width)`, for images that lie as [`super::image`] says.
    pub(super) fn pack_for_images(level: Level, shape: ConvShape, weights: &[f32]) -> Option<Self> {
        let deep = |phase: Phase| deepest(phase.run::<Bf16Pair>(&shape.window)).is_some();
        if level.tiles().is_none() || !Phase::all::<Bf16Pair>(&shape.window).all(deep) {
            return None;
        }
        let number = |run, weight: usize| half(weights[weight], run == 1);
        Some(Self {
            level,
            shape,
            weights: Weights::Images(image::panels(level, &shape, 2, number)),
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
        let (grid, size, [step, numbers, pitch], parts) = match &self.weights {
            Weights::Maps(groups) if pixels(window.size) == 1 => {
                for_each_band(threads, to, target, |band| {
                    let parts = self.parts(groups, window, from);
                    self.write_pixels(&parts, (source, from), (band, to), epilogue);
                });
                return;
            }
            Weights::Maps(groups) => {
                let grid = Grid {
                    before: from.before,
                    after: from.after,
                    ..Grid::tight(from.frames, from.size, 2 * words(self.shape.inputs))
                };
                let runs = [from.pitch, self.shape.inputs, grid.pitch];
                (grid, window.size, runs, self.parts(groups, window, &grid))
            }
            Weights::Images(phases) => {
                // A row of numbers becomes one of both halves.
                let numbers = rows_of_words::<f32>(from).size[2];
                let mut grid = rows_of_words::<Bf16Pair>(from);
                grid.size[2] *= 2;
                let phases = phases.iter().map(|(phase, panels)| Part {
                    lattice: phase.lattice(window, from),
                    word: 0,
                    column: 0,
                    panels,
                });
                let [time, height, _] = window.size;
                let runs = [numbers, numbers, grid.size[2]];
                (grid, [time, height, 1], runs, phases.collect())
            }
        };
        let memory = self.split_all(threads, (source, step, numbers), pitch);
        let halves = Halves {
            memory: &memory,
            grid,
            taps: grid.taps(size),
            lower: pitch / 2,
        };
        halves.convolve(&parts, threads, (target, to), epilogue);
    }

    /// The groups of a convolution of maps that lie like this.
    fn parts<'a>(
        &self,
        groups: &'a [Panels<Bf16Pair>],
        window: &Window,
        from: &Grid,
    ) -> Vec<Part<'a>> {
        let [inputs, outputs] = [self.shape.group_inputs(), self.shape.group_outputs()];
        let part = |(group, panels)| Part {
            lattice: Lattice::of_window(window, from),
            word: words(group * inputs),
            column: group * outputs,
            panels,
        };
        groups.iter().enumerate().map(part).collect()
    }

    /// Convolves by a window of one pixel. Pixels are split a few at a time, which then stay in the cache.
    fn write_pixels(
        &self,
        parts: &[Part<'_>],
        (source, from): (&[f32], &Grid),
        (band, to): (Band<'_>, &Grid),
        epilogue: Epilogue<'_>,
    ) {
        let numbers = self.shape.inputs;
        let lower = words(numbers);
        let Some(Part { lattice, .. }) = parts.first() else {
            return;
        };
        let reach = lattice.reach(band.rows(to), from, to);
        let all = reach.places.len().max(1);
        let of_frame = if epilogue.per_frame() {
            all.div_ceil(band.frames.len().max(1))
        } else {
            all
        };
        let count = (NEAR / (2 * lower)).max(PIXELS).min(of_frame);
        let mut memory = Buffer::<Bf16Pair>::zeros(count * 2 * lower);
        let rows = starts(count, 2 * lower);
        let frames = reach.starts.chunks(of_frame);
        let frames = frames.zip(reach.places.chunks(of_frame));
        for (frame, (pixels, places)) in frames.enumerate() {
            let epilogue = epilogue.from(band.frames.start + frame, 0);
            for (pixels, places) in pixels.chunks(count).zip(places.chunks(count)) {
                self.split((source, pixels, numbers), (&mut memory, 2 * lower));
                let rows = &rows[..places.len()];
                for part in parts {
                    let (source, target) = (&memory[..], &mut *band.target);
                    let product = part.product((source, rows), (&[0], lower), epilogue);
                    product.write_by_tiles(&mut target[part.column..], places, band.origin);
                }
            }
        }
    }

    /// Splits runs of so many numbers, of which one begins every `step` numbers; their halves lie `pitch` words apart.
    fn split_all(
        &self,
        threads: Threads,
        (source, step, numbers): (&[f32], usize, usize),
        pitch: usize,
    ) -> Buffer<Bf16Pair> {
        let runs = starts(source.len() / step, step);
        let mut memory = Buffer::zeros(runs.len() * pitch);
        let at_once = (NEAR / pitch).max(1);
        let parts = runs.chunks(at_once);
        let parts = parts.zip(memory.chunks_mut(at_once * pitch));
        let split = |(runs, target): (&[usize], &mut [_])| {
            self.split((source, runs, numbers), (target, pitch));
        };
        match threads {
            Threads::One => parts.for_each(split),
            Threads::All => on_all_threads(parts.collect(), split),
        }
        memory
    }

    /// The same of runs that begin at these numbers.
    fn split(
        &self,
        (source, starts, numbers): (&[f32], &[usize], usize),
        (target, pitch): (&mut [Bf16Pair], usize),
    ) {
        let halve = Halve {
            source,
            starts,
            numbers,
            target,
            pitch,
        };
        Bf16Pair::run(self.level, halve);
    }
}

impl Halves<'_> {
    /// Writes all parts of the output.
    fn convolve(
        &self,
        parts: &[Part<'_>],
        threads: Threads,
        (target, to): (&mut [f32], &Grid),
        epilogue: Epilogue<'_>,
    ) {
        for_each_band(threads, to, target, |band| {
            let epilogue = epilogue.from(band.frames.start, 0);
            for part in parts {
                let rows = part.lattice.rows_within(band.rows(to), to.size);
                let reach = part.lattice.reach(rows, &self.grid, to);
                let rows = (self.memory, &reach.starts[..]);
                let product = Product {
                    frame_rows: reach.places.len() / band.frames.len().max(1),
                    ..part.product(rows, (&self.taps, self.lower), epilogue)
                };
                let target = &mut band.target[part.column..];
                product.write_by_tiles(target, &reach.places, band.origin);
            }
        });
    }
}

impl Part<'_> {
    /// The product that writes it, of rows that begin at these words, all of one frame.
    fn product<'a>(
        &'a self,
        (source, rows): (&'a [Bf16Pair], &'a [usize]),
        (taps, lower): (&'a [usize], usize),
        epilogue: Epilogue<'a>,
    ) -> Product<'a, Bf16Pair> {
        Product {
            source: &source[self.word..],
            rows,
            frame_rows: rows.len(),
            taps,
            run: self.panels.k / (2 * taps.len()),
            lower: Some(lower),
            panels: self.panels.all(),
            epilogue: epilogue.from(0, self.column),
        }
    }
}

/// Splits runs of so many numbers, one from each of `starts` on.
struct Halve<'a> {
    source: &'a [f32],
    starts: &'a [usize],
    numbers: usize,
    target: &'a mut [Bf16Pair],
    /// Words of both halves of a run.
    pitch: usize,
}

impl WordKernel<Bf16Pair> for Halve<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = Bf16Pair>>(self, lanes: S, arithmetic: A) {
        if !const { compiled::<S, A>() } {
            return;
        }
        let whole = 2 * S::F32_LANES;
        let runs = self.starts.iter();
        for (start, target) in runs.zip(self.target.chunks_exact_mut(self.pitch)) {
            let (upper, lower) = target.split_at_mut(self.pitch / 2);
            let numbers = self.source[*start..][..self.numbers].chunks(whole);
            let upper = upper.chunks_mut(S::F32_LANES);
            let halves = upper.zip(lower.chunks_mut(S::F32_LANES));
            for (numbers, (upper, lower)) in numbers.zip(halves) {
                if numbers.len() == whole {
                    halve::<S, A, true>(lanes, arithmetic, numbers, [upper, lower]);
                } else {
                    let words = Bf16Pair::words(numbers.len());
                    let ends = [&mut upper[..words], &mut lower[..words]];
                    halve::<S, A, false>(lanes, arithmetic, numbers, ends);
                }
            }
        }
    }
}

/// Splits the numbers of two vectors; `WHOLE` where there are as many.
#[inline(always)]
fn halve<S: Lanes, A: Arithmetic<S, Word = Bf16Pair>, const WHOLE: bool>(
    lanes: S,
    arithmetic: A,
    numbers: &[f32],
    [upper, lower]: [&mut [Bf16Pair]; 2],
) {
    let mut rests = vectors::<S, 2, WHOLE>(lanes, numbers);
    arithmetic.write::<2, WHOLE>(lanes, rests, upper);
    let uppers = arithmetic.read::<2, WHOLE>(lanes, upper);
    // No closure: one that is not inlined is compiled without the instructions.
    for (rest, upper) in rests.iter_mut().zip(uppers) {
        let left = lanes.sub_f32s(*rest, upper);
        let finite = lanes.equal_f32s(left, left);
        *rest = lanes.select_f32s(finite, left, lanes.splat_f32s(0.0));
    }
    arithmetic.write::<2, WHOLE>(lanes, rests, lower);
}

/// Words of one half of so many channels.
const fn words(channels: usize) -> usize {
    channels.div_ceil(CHANNELS) * WORDS
}
