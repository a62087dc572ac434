//! Dense convolutions of 3 x 3 by fewer products: Winograd's minimal filtering (Lavin and Gray 2016).
//!
//! A tile of 2 x 2 outputs takes 16 products of each pair of channels in place of 36, one of 4 x 4 takes 36
//! in place of 144: of its inputs and of the weights, each transformed by sums. A window over several time
//! steps is one such window for each, and their products are one sum.
//!
//! Sums round more than those of the convolution itself (`docs/kernels.md`). That does for embeddings and for
//! gradients; in a forward pass that is trained on, more inputs of rectifiers that are all but zero would come
//! to lie on its other side, and each moves all gradients before it.
//!
//! Tiles begin at the same rows and columns of each frame, so that no number depends on what is computed
//! beside it.

mod gradient;
mod points;
mod transforms;

use std::cell::Cell;
use std::ops::Range;

use super::bands::{Threads, for_each_band_of};
use super::buffer::Buffer;
use super::grid::{Grid, Size, Window, pixels, starts};
use super::panels::{PanelRun, Panels};
use super::product::{Epilogue, Product, write_shared};
use super::words::Word;
pub(super) use gradient::weight_gradient;
use transforms::{TransformInputs, TransformOutputs, TransformWeights};

/// Fewer channels than this, and the transforms take longer than the products they save.
const FEWEST_CHANNELS: usize = 32;

/// Channels come in so many, which fill the vectors of every level: the bits are the same on all of them.
const CHANNELS: usize = 16;

/// More weights of a tap than this, transformed, are not read in the time that is saved: by tiles of 4 x 4, which
/// have four times as many, and by any.
const MOST_WEIGHTS_OF_LARGE: usize = 1 << 14;
const MOST_WEIGHTS: usize = 1 << 17;

/// Fewer pixels of a frame than this meet the weights too seldom.
const FEWEST_PIXELS: usize = 100;

/// Words of the transformed inputs and outputs that stay in a core's second-level cache.
const CACHE: usize = 256 << 10;

/// Weights of a convolution, transformed.
#[derive(Debug, Clone)]
pub(super) struct Winograd {
    /// Inputs of a tile along height and width, two more than outputs: 4 or 6.
    side: usize,
    /// Time steps of the window.
    times: usize,
    /// `(times * inputs, outputs)` of each product.
    weights: Vec<Panels>,
}

/// Where a convolution reads, and where its outputs lie.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach<'a, W = f32> {
    pub(super) source: &'a [W],
    pub(super) from: &'a Grid,
    /// Where the window begins at each pixel.
    pub(super) starts: &'a [usize],
    pub(super) to: &'a Grid,
    /// Where each pixel of them lies.
    pub(super) places: &'a [usize],
}

/// Pixels that are computed together.
#[derive(Debug, Clone, Copy)]
struct Tile {
    frame: usize,
    pixel: usize,
    /// How many of its rows and columns there are.
    extent: [usize; 2],
}

impl Winograd {
    /// From the panels of a convolution's matrix, whose rows are those of each tap in turn, or from the last
    /// tap to the first where the window is `turned`. None where the window is another or the products are
    /// not worth it.
    pub(super) fn of<W: Word>(
        threads: Threads,
        window: &Window,
        [inputs, outputs]: [usize; 2],
        direct: &Panels<W>,
        turned: bool,
    ) -> Option<Self> {
        let by_tiles = W::NUMBERS > 1 && direct.level.tiles().is_some();
        if W::WHOLE || by_tiles || !worth_it(window, [inputs, outputs]) {
            return None;
        }
        let times = window.size[0];
        let side = if inputs * outputs <= MOST_WEIGHTS_OF_LARGE {
            6
        } else if W::NUMBERS == 1 {
            4
        } else {
            // Products of bf16 are twice as fast as those of f32, in which tiles are multiplied.
            return None;
        };
        let level = direct.level;
        let make = |panel: &[f32], products: &mut [&mut [f32]]| {
            let tap = panel.len() / (9 * times);
            match side {
                4 => level.run(TransformWeights::<4> {
                    panel,
                    products,
                    tap,
                    turned,
                }),
                _ => level.run(TransformWeights::<6> {
                    panel,
                    products,
                    tap,
                    turned,
                }),
            }
        };
        let weights = direct.derived(threads, times * inputs, side * side, make);
        Some(Self {
            side,
            times,
            weights,
        })
    }

    pub(super) fn serves(size: Size) -> bool {
        size[1] * size[2] >= FEWEST_PIXELS
    }

    pub(super) fn apply<W: Word>(
        &self,
        threads: Threads,
        reach: Reach<'_, W>,
        target: &mut [W],
        epilogue: Epilogue<'_>,
    ) {
        let write = match self.side {
            4 => Self::write_tiles::<W, 4>,
            _ => Self::write_tiles::<W, 6>,
        };
        let outweigh = |panels: &Panels| panels.outweigh(reach.from, reach.to);
        let heavy = threads == Threads::All && self.weights.first().is_some_and(outweigh);
        let weights: Vec<_> = self.weights.iter().map(Panels::all).collect();
        if heavy {
            let whole = 0..pixels(reach.to.size) * reach.to.frames;
            write_shared(
                &weights,
                (target, reach.places),
                epilogue,
                |weights, epilogue, block, places| {
                    let reach = Reach { places, ..reach };
                    write(self, weights, &reach, whole.clone(), (block, 0), epilogue);
                },
            );
            return;
        }
        for_each_band_of(self.side - 2, threads, reach.to, target, |band| {
            let target = (band.target, band.origin);
            write(self, &weights, &reach, band.pixels, target, epilogue);
        });
    }

    /// Computes pixels, which are whole rows of tiles, of `SIDE x SIDE` inputs each.
    fn write_tiles<W: Word, const SIDE: usize>(
        &self,
        weights: &[PanelRun<'_, f32>],
        reach: &Reach<'_, W>,
        band: Range<usize>,
        (target, origin): (&mut [W], usize),
        epilogue: Epilogue<'_>,
    ) {
        let Some(first) = weights.first() else { return };
        let (level, k, n) = (first.level, first.k, first.n);
        let count = SIDE * SIDE;
        let tiles = tiles(SIDE - 2, reach.to.size, band);
        let most = (CACHE / (count * (k + n))).max(1);
        let chunks = tiles.len().div_ceil(most);
        let mut memory = MEMORY.take();
        for chunk in 0..chunks {
            let at = |chunk: usize| tiles.len() * chunk / chunks;
            let tiles = &tiles[at(chunk)..at(chunk + 1)];
            let (inputs, outputs) = (tiles.len() * k, tiles.len() * n);
            memory.resize(count * (inputs + outputs));
            let (seen, products) = memory.split_at_mut(count * inputs);
            let run = k / self.times;
            let of_inputs = TransformInputs::<W, SIDE> {
                reach,
                tiles,
                times: self.times,
                run,
                target: &mut *seen,
            };
            W::run(level, of_inputs);
            self.multiply(weights, tiles.len(), seen, products);
            let of_outputs = TransformOutputs::<W, SIDE> {
                reach,
                tiles,
                n,
                products,
                target: &mut *target,
                origin,
                epilogue,
            };
            W::run(level, of_outputs);
        }
        MEMORY.set(memory);
    }

    /// `(products, tiles, outputs)` from transformed inputs, `(products, times, tiles, inputs)`.
    fn multiply(
        &self,
        weights: &[PanelRun<'_, f32>],
        tiles: usize,
        seen: &[f32],
        products: &mut [f32],
    ) {
        let count = seen.len() / weights.len();
        let run = count / (self.times * tiles);
        let n = products.len() / (weights.len() * tiles);
        let (rows, places) = (starts(tiles, run), starts(tiles, n));
        let taps = starts(self.times, tiles * run);
        let sources = seen.chunks_exact(count);
        let targets = products.chunks_exact_mut(tiles * n);
        for (&panels, (source, target)) in weights.iter().zip(sources.zip(targets)) {
            let product = Product {
                source,
                rows: &rows,
                frame_rows: tiles,
                taps: &taps,
                run,
                panels,
                lower: None,
                epilogue: Epilogue::default(),
            };
            product.write(target, &places, 0);
        }
    }
}

thread_local! {
    /// Transformed inputs and outputs: fresh memory is slow.
    static MEMORY: Cell<Buffer> = Cell::default();
}

/// Whether a window and its channels take fewer products.
fn worth_it(window: &Window, [inputs, outputs]: [usize; 2]) -> bool {
    let [_, height, width] = window.size;
    (height, width, window.stride) == (3, 3, [1; 3])
        && inputs.min(outputs) >= FEWEST_CHANNELS
        && inputs * outputs <= MOST_WEIGHTS
        && inputs.is_multiple_of(CHANNELS)
        && outputs.is_multiple_of(CHANNELS)
}

/// The tiles of pixels, which are whole rows of tiles.
fn tiles(side: usize, [time, height, width]: Size, band: Range<usize>) -> Vec<Tile> {
    let rows = band.start / width.max(1)..band.end / width.max(1);
    let rows = rows.filter(|row| (row % height).is_multiple_of(side));
    let tile = |row: usize, x: usize| Tile {
        frame: row / (time * height),
        pixel: row * width + x,
        extent: [side.min(height - row % height), side.min(width - x)],
    };
    rows.flat_map(|row| (0..width).step_by(side).map(move |x| tile(row, x)))
        .collect()
}
