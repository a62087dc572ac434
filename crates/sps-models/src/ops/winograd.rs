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

use std::cell::Cell;
use std::ops::Range;

use rayon::prelude::*;

use super::bands::{Threads, for_each_band_of};
use super::buffer::Buffer;
use super::grid::{Grid, Size, Window, pixels};
use super::outer::Outer;
use super::panels::{PanelRun, Panels};
use super::product::{Epilogue, Finish, Product, write_shared};
use super::simd::{Kernel, Lanes, Level, load};
use super::words::{Arithmetic, Word, WordKernel};

/// Fewer channels than this, and the transforms take longer than the products they save.
const FEWEST_CHANNELS: usize = 32;

/// Channels come in so many, which fill the vectors of every level: the bits are the same on all of them.
const CHANNELS: usize = 16;

/// More weights of a tap than this, transformed, are not read in the time that is saved: by tiles of 4 x 4, which
/// have four times as many, and by any.
const MOST_WEIGHTS_OF_LARGE: usize = 1 << 14;
const MOST_WEIGHTS: usize = 1 << 17;

/// The same of the weights' gradient, whose sums are read and written for each chunk of tiles.
const MOST_WEIGHTS_OF_GRADIENT: usize = 1 << 14;

/// Parts of frames whose sums of products are joined in order.
const MOST_PARTS: usize = 8;

/// Fewer pixels of a frame than this meet the weights too seldom.
const FEWEST_PIXELS: usize = 100;

/// Words of the transformed inputs and outputs that stay in a core's second-level cache.
const CACHE: usize = 256 << 10;

/// Weights of a convolution, transformed.
#[derive(Debug, Clone)]
pub(super) struct Winograd {
    size: TileSize,
    /// Time steps of the window.
    times: usize,
    /// `(times * inputs, outputs)` of each product.
    weights: Vec<Panels>,
}

/// How many outputs a tile has along height and width.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TileSize {
    /// From 4 x 4 inputs.
    Two,
    /// From 6 x 6 inputs.
    Four,
}

impl TileSize {
    const fn outputs(self) -> usize {
        match self {
            Self::Two => 2,
            Self::Four => 4,
        }
    }

    /// Products of a pair of channels.
    const fn products(self) -> usize {
        let side = self.outputs() + 2;
        side * side
    }
}

/// Where a convolution reads and writes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach<'a> {
    pub(super) source: &'a [f32],
    pub(super) from: &'a Grid,
    /// Where the window begins at each pixel.
    pub(super) starts: &'a [usize],
    pub(super) to: &'a Grid,
    /// Where each pixel is written.
    pub(super) places: &'a [usize],
    pub(super) epilogue: Epilogue<'a>,
}

/// Pixels that are computed together.
#[derive(Debug, Clone, Copy)]
struct Tile {
    frame: usize,
    /// The first pixel.
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
        groups: &[Panels<W>],
        turned: bool,
    ) -> Option<Self> {
        let [panels] = groups else {
            return None;
        };
        let direct = panels.of_numbers()?;
        if !worth_it(window, [inputs, outputs]) {
            return None;
        }
        let times = window.size[0];
        let size = if inputs * outputs <= MOST_WEIGHTS_OF_LARGE {
            TileSize::Four
        } else {
            TileSize::Two
        };
        let weights = direct.derived(
            threads,
            times * inputs,
            size.products(),
            |panel, products| {
                let (level, tap) = (direct.all().level(), panel.len() / (9 * times));
                match size {
                    TileSize::Two => level.run(TransformWeights::<4> {
                        panel,
                        products,
                        tap,
                        turned,
                    }),
                    TileSize::Four => level.run(TransformWeights::<6> {
                        panel,
                        products,
                        tap,
                        turned,
                    }),
                }
            },
        );
        Some(Self {
            size,
            times,
            weights,
        })
    }

    /// Whether maps of this size are worth it.
    pub(super) fn serves(size: Size) -> bool {
        size[1] * size[2] >= FEWEST_PIXELS
    }

    /// Convolves.
    pub(super) fn apply(&self, threads: Threads, reach: Reach<'_>, target: &mut [f32]) {
        let whole = 0..pixels(reach.to.size) * reach.to.frames;
        let heaviest = self.weights.first();
        let outweigh = heaviest.is_some_and(|panels| panels.outweigh(reach.from, reach.to));
        if threads == Threads::All && outweigh {
            let runs: Vec<Vec<_>> = self
                .weights
                .iter()
                .map(|p| p.all().split(rayon::current_num_threads()))
                .collect();
            let of = |run: usize| runs.iter().map(|runs| runs[run]).collect::<Vec<_>>();
            let columns: Vec<_> = runs
                .first()
                .into_iter()
                .flatten()
                .enumerate()
                .map(|(i, run)| (run.column(), run.n(), of(i)))
                .collect();
            write_shared(
                &columns,
                (target, reach.places),
                reach.epilogue,
                |weights, epilogue, block, places| {
                    let reach = Reach {
                        places,
                        epilogue,
                        ..reach
                    };
                    self.write(weights, &reach, whole.clone(), (block, 0));
                },
            );
            return;
        }
        let weights: Vec<_> = self.weights.iter().map(Panels::all).collect();
        for_each_band_of(self.size.outputs(), threads, reach.to, target, |band| {
            self.write(&weights, &reach, band.pixels, (band.target, band.origin));
        });
    }

    /// Computes pixels, which are whole rows of tiles.
    fn write(
        &self,
        weights: &[PanelRun<'_, f32>],
        reach: &Reach<'_>,
        band: Range<usize>,
        (target, origin): (&mut [f32], usize),
    ) {
        let Some(first) = weights.first() else { return };
        let (level, k, n) = (first.level(), first.k(), first.n());
        let count = self.size.products();
        let tiles = tiles(self.size.outputs(), reach.to.size, band);
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
            let of_inputs = Inputs {
                reach,
                tiles,
                times: self.times,
                run,
                target: &mut *seen,
            };
            match self.size {
                TileSize::Two => level.run(TransformInputs::<4>(of_inputs)),
                TileSize::Four => level.run(TransformInputs::<6>(of_inputs)),
            }
            self.multiply(weights, tiles.len(), seen, products);
            let of_outputs = Outputs {
                reach,
                tiles,
                n,
                products,
                target: &mut *target,
                origin,
            };
            match self.size {
                TileSize::Two => f32::run(level, TransformOutputs::<4>(of_outputs)),
                TileSize::Four => f32::run(level, TransformOutputs::<6>(of_outputs)),
            }
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
        let steps = |count: usize, step: usize| (0..count).map(|i| i * step).collect::<Vec<_>>();
        let count = seen.len() / weights.len();
        let run = count / (self.times * tiles);
        let n = products.len() / (weights.len() * tiles);
        let (rows, places) = (steps(tiles, run), steps(tiles, n));
        let taps = steps(self.times, tiles * run);
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

/// The gradient of the weights, `(outputs, inputs, time, height, width)`, by tiles of 2 x 2 outputs: of each tile
/// 16 products of a pair of channels in place of 36. False where the window is another or it is not worth it.
/// Frames are summed in parts, and the parts in order.
pub(super) fn weight_gradient(
    level: Level,
    window: &Window,
    [inputs, outputs]: [usize; 2],
    reach: &Reach<'_>,
    gradient: &[f32],
    target: &mut [f32],
) -> bool {
    let (frames, size) = (reach.to.frames, reach.to.size);
    let serves = worth_it(window, [inputs, outputs])
        && inputs * outputs <= MOST_WEIGHTS_OF_GRADIENT
        && Winograd::serves(size);
    if !serves {
        return false;
    }
    let times = window.size[0];
    let parts = frames.min(MOST_PARTS);
    let part = |part: usize| {
        let at = |part: usize| frames * part / parts * pixels(size);
        let tiles = tiles(2, size, at(part)..at(part + 1));
        let shape = [times, inputs, outputs];
        sums_of_products(level, shape, reach, gradient, &tiles)
    };
    let parts: Vec<Vec<f32>> = (0..parts).into_par_iter().map(part).collect();
    let rows = target.par_chunks_exact_mut(inputs * 9 * times).enumerate();
    rows.for_each(|(output, target)| {
        for time in 0..times {
            let mut sums = vec![[0.0; TileSize::Two.products()]; inputs];
            for part in &parts {
                let products = part.chunks_exact(times * outputs * inputs);
                for (product, part) in products.enumerate() {
                    let row = &part[(time * outputs + output) * inputs..][..inputs];
                    for (sum, value) in sums.iter_mut().zip(row) {
                        sum[product] += value;
                    }
                }
            }
            for (sums, target) in sums.iter().zip(target.chunks_exact_mut(9 * times)) {
                target[9 * time..][..9].copy_from_slice(&of_sums(sums));
            }
        }
    });
    true
}

/// `(products, times, outputs, inputs)`: sums over tiles of the products of their inputs with the gradients of
/// their outputs, both transformed.
fn sums_of_products(
    level: Level,
    [times, inputs, outputs]: [usize; 3],
    reach: &Reach<'_>,
    gradient: &[f32],
    tiles: &[Tile],
) -> Vec<f32> {
    let count = TileSize::Two.products();
    let mut sums = vec![0.0; count * times * inputs * outputs];
    let most = (CACHE / (count * (times * inputs + outputs))).max(1);
    let mut memory = MEMORY.take();
    for tiles in tiles.chunks(most) {
        let seen = count * times * tiles.len() * inputs;
        memory.resize(seen + count * tiles.len() * outputs);
        let (seen, slopes) = memory.split_at_mut(seen);
        level.run(TransformInputs::<4>(Inputs {
            reach,
            tiles,
            times,
            run: inputs,
            target: &mut *seen,
        }));
        level.run(TransformGradients {
            reach,
            gradient,
            tiles,
            n: outputs,
            target: &mut *slopes,
        });
        let rows = |step: usize| (0..tiles.len()).map(|i| i * step).collect::<Vec<_>>();
        let (left_rows, right_rows) = (rows(outputs), rows(inputs));
        for (i, sums) in sums.chunks_exact_mut(inputs * outputs).enumerate() {
            let outer = Outer {
                left: &slopes[i / times * tiles.len() * outputs..],
                left_rows: &left_rows,
                right: &seen[i * tiles.len() * inputs..],
                right_rows: &right_rows,
                height: outputs,
                width: inputs,
            };
            outer.add(level, sums, inputs);
        }
    }
    MEMORY.set(memory);
    sums
}

/// The gradient of the weights of a pair of channels from its sums, by tiles of 2 x 2: `G^T s G`.
fn of_sums(sums: &[f32; 16]) -> [f32; 9] {
    let fold = |[a, b, c, d]: [f32; 4]| {
        let ends = 0.5 * (b + c);
        [a + ends, 0.5 * (b - c), ends + d]
    };
    let [a, b, c, d] =
        [0, 1, 2, 3].map(|x| fold([sums[x], sums[4 + x], sums[8 + x], sums[12 + x]]));
    let row = |y: usize| fold([a[y], b[y], c[y], d[y]]);
    let [first, second, third] = [row(0), row(1), row(2)];
    let mut gradient = [0.0; 9];
    for (target, row) in gradient.chunks_exact_mut(3).zip([first, second, third]) {
        target.copy_from_slice(&row);
    }
    gradient
}

/// `A y A^T` of each tile and channel of an output's gradient, by tiles of 2 x 2.
struct TransformGradients<'a> {
    reach: &'a Reach<'a>,
    gradient: &'a [f32],
    tiles: &'a [Tile],
    /// Channels.
    n: usize,
    /// `(products, tiles, channels)`
    target: &'a mut [f32],
}

impl Kernel for TransformGradients<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        let Reach { places, to, .. } = *self.reach;
        let step = self.tiles.len() * self.n;
        let nothing = lanes.splat_f32s(0.0);
        for (number, tile) in self.tiles.iter().enumerate() {
            let [rows, columns] = tile.extent;
            for channel in (0..self.n).step_by(S::F32_LANES) {
                let mut values = [[nothing; 4]; 2];
                for (x, column) in values.iter_mut().enumerate() {
                    let mut own = [nothing; 2];
                    for (y, own) in own.iter_mut().enumerate() {
                        if y < rows && x < columns {
                            let place = places[tile.pixel + y * to.size[2] + x];
                            *own = load(lanes, &self.gradient[place + channel..]);
                        }
                    }
                    *column = of_gradients(lanes, own);
                }
                let [left, right] = values;
                for (y, (left, right)) in left.into_iter().zip(right).enumerate() {
                    let row = of_gradients(lanes, [left, right]);
                    for (x, value) in row.into_iter().enumerate() {
                        let at = (4 * y + x) * step + number * self.n + channel;
                        store(lanes, value, &mut self.target[at..]);
                    }
                }
            }
        }
    }
}

/// Gradients of a column or row of outputs to those at the points: `A y`.
#[inline(always)]
fn of_gradients<S: Lanes>(lanes: S, [a, b]: [S::f32s; 2]) -> [S::f32s; 4] {
    let nothing = lanes.splat_f32s(0.0);
    [
        a,
        lanes.add_f32s(a, b),
        lanes.sub_f32s(a, b),
        lanes.sub_f32s(nothing, b),
    ]
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

/// Two of the points of F(4x4, 3x3), 0, ±p, ±q and infinity, with p q = 1: where polynomials are multiplied
/// value by value. Powers of 2, which are common, round twice as much.
const P: f32 = 2.0 / 3.0;
const Q: f32 = 1.5;

/// Inputs of a column or row of a tile to values at the points: `B^T d`.
#[inline(always)]
fn of_inputs<S: Lanes>(lanes: S, line: &mut [S::f32s]) {
    let add = |x, y| lanes.add_f32s(x, y);
    let sub = |x, y| lanes.sub_f32s(x, y);
    let fma = |factor, x, y| lanes.fma(lanes.splat_f32s(factor), x, y);
    let mul = |factor, x| lanes.mul_f32s(lanes.splat_f32s(factor), x);
    match *line {
        [a, b, c, d] => line.copy_from_slice(&[sub(a, c), add(b, c), sub(c, b), sub(b, d)]),
        [a, b, c, d, e, f] => {
            const SQUARES: f32 = P * P + Q * Q;
            let (even, odd) = (fma(-Q * Q, c, e), fma(P, d, mul(-Q, b)));
            let (even_q, odd_q) = (fma(-P * P, c, e), fma(Q, d, mul(-P, b)));
            line.copy_from_slice(&[
                fma(-SQUARES, c, add(a, e)),
                add(even, odd),
                sub(even, odd),
                add(even_q, odd_q),
                sub(even_q, odd_q),
                fma(-SQUARES, d, add(b, f)),
            ]);
        }
        _ => {}
    }
}

/// Weights of a column or row to values at the points: `G g`.
#[inline(always)]
fn of_weights<S: Lanes>(lanes: S, [a, b, c]: [S::f32s; 3], line: &mut [S::f32s]) {
    let mul = |factor, x| lanes.mul_f32s(lanes.splat_f32s(factor), x);
    // At a point and its opposite, times a factor.
    let at = |point: f32, factor: f32| {
        let squared = lanes.splat_f32s(point * point * factor);
        let even = lanes.fma(squared, c, mul(factor, a));
        let odd = mul(point * factor, b);
        [lanes.add_f32s(even, odd), lanes.sub_f32s(even, odd)]
    };
    if let [_, _, _, _] = line {
        let [one, minus_one] = at(1.0, 0.5);
        line.copy_from_slice(&[a, one, minus_one, c]);
    } else {
        let [p, minus_p] = at(P, 1.0 / (2.0 * P * P * (P * P - Q * Q)));
        let [q, minus_q] = at(Q, 1.0 / (2.0 * Q * Q * (Q * Q - P * P)));
        line.copy_from_slice(&[a, p, minus_p, q, minus_q, c]);
    }
}

/// Values at the points of a column or row to outputs, as many as there are: `A^T m`.
#[inline(always)]
fn of_products<S: Lanes>(lanes: S, line: &mut [S::f32s]) {
    let add = |x, y| lanes.add_f32s(x, y);
    let sub = |x, y| lanes.sub_f32s(x, y);
    // A power of each point times what stands there.
    let at = |[p, q]: [f32; 2], x, y| {
        let product = lanes.mul_f32s(lanes.splat_f32s(p), x);
        lanes.fma(lanes.splat_f32s(q), y, product)
    };
    match *line {
        [a, b, c, d] => line[..2].copy_from_slice(&[add(a, add(b, c)), sub(sub(b, c), d)]),
        [a, b, c, d, e, f] => {
            let (even, odd) = (add(b, c), sub(b, c));
            let (even_q, odd_q) = (add(d, e), sub(d, e));
            line[..4].copy_from_slice(&[
                add(a, add(even, even_q)),
                at([P, Q], odd, odd_q),
                at([P * P, Q * Q], even, even_q),
                add(at([P * P * P, Q * Q * Q], odd, odd_q), f),
            ]);
        }
        _ => {}
    }
}

/// `G g G^T` of each pair of channels.
struct TransformWeights<'a, 'b, const SIDE: usize> {
    panel: &'a [f32],
    products: &'a mut [&'b mut [f32]],
    /// Numbers of each tap.
    tap: usize,
    turned: bool,
}

impl<const SIDE: usize> Kernel for TransformWeights<'_, '_, SIDE> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        let (panel, _) = S::as_simd_f32s(self.panel);
        let (tap, taps) = (self.tap / S::F32_LANES, self.panel.len() / self.tap);
        for at in 0..taps / 9 * tap {
            let (time, at_of_tap) = (at / tap, at % tap);
            let weight = |y: usize, x: usize| {
                let number = 9 * time + 3 * y + x;
                let number = if self.turned {
                    taps - 1 - number
                } else {
                    number
                };
                panel[number * tap + at_of_tap]
            };
            let mut columns = [[lanes.splat_f32s(0.0); SIDE]; 3];
            for (x, column) in columns.iter_mut().enumerate() {
                of_weights(lanes, [weight(0, x), weight(1, x), weight(2, x)], column);
            }
            for (y, products) in self.products.chunks_exact_mut(SIDE).enumerate() {
                let mut row = [lanes.splat_f32s(0.0); SIDE];
                let [a, b, c] = &columns;
                of_weights(lanes, [a[y], b[y], c[y]], &mut row);
                for (product, value) in products.iter_mut().zip(row) {
                    S::as_mut_simd_f32s(product).0[at] = value;
                }
            }
        }
    }
}

/// `B^T d B` of each tile, time step and channel.
struct TransformInputs<'a, const SIDE: usize>(Inputs<'a>);

struct Inputs<'a> {
    reach: &'a Reach<'a>,
    tiles: &'a [Tile],
    times: usize,
    /// Channels.
    run: usize,
    /// `(products, times, tiles, channels)`
    target: &'a mut [f32],
}

impl<const SIDE: usize> Kernel for TransformInputs<'_, SIDE> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        let Inputs {
            reach,
            tiles,
            times,
            run,
            target,
        } = self.0;
        let Reach {
            source,
            from,
            starts,
            ..
        } = *reach;
        let (row, pitch) = (from.extent(2) * from.pitch, from.pitch);
        let step = times * tiles.len() * run;
        for time in 0..times {
            for (number, tile) in tiles.iter().enumerate() {
                let start = starts[tile.pixel] + time * from.extent(1) * row;
                // Behind the last row and column that its outputs need there may be none.
                let [last_row, last_column] = tile.extent.map(|extent| extent + 1);
                let end = start + last_row * row + last_column * pitch + run;
                let inputs = &source[start..end];
                let first = (time * tiles.len() + number) * run;
                for channel in (0..run).step_by(S::F32_LANES) {
                    let mut columns = [[lanes.splat_f32s(0.0); SIDE]; SIDE];
                    for (x, column) in columns.iter_mut().enumerate() {
                        let at = x.min(last_column) * pitch + channel;
                        for (y, input) in column.iter_mut().enumerate() {
                            *input = load(lanes, &inputs[y.min(last_row) * row + at..]);
                        }
                        of_inputs(lanes, column);
                    }
                    for y in 0..SIDE {
                        let mut values = [lanes.splat_f32s(0.0); SIDE];
                        for (value, column) in values.iter_mut().zip(&columns) {
                            *value = column[y];
                        }
                        of_inputs(lanes, &mut values);
                        for (x, value) in values.into_iter().enumerate() {
                            let at = (SIDE * y + x) * step + first + channel;
                            store(lanes, value, &mut target[at..]);
                        }
                    }
                }
            }
        }
    }
}

/// `A^T m A` of each tile and channel, and what happens to sums.
struct TransformOutputs<'a, const SIDE: usize>(Outputs<'a>);

struct Outputs<'a> {
    reach: &'a Reach<'a>,
    tiles: &'a [Tile],
    /// Channels.
    n: usize,
    /// `(products, tiles, channels)`
    products: &'a [f32],
    target: &'a mut [f32],
    origin: usize,
}

impl<const SIDE: usize> WordKernel<f32> for TransformOutputs<'_, SIDE> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = f32>>(self, lanes: S, arithmetic: A) {
        let Outputs {
            reach,
            tiles,
            n,
            products,
            target,
            origin,
        } = self.0;
        let Reach {
            places,
            epilogue,
            to,
            ..
        } = *reach;
        let step = tiles.len() * n;
        for (number, tile) in tiles.iter().enumerate() {
            for channel in (0..n).step_by(S::F32_LANES) {
                let columns = (channel, S::F32_LANES);
                let finish = Finish::<S, 1>::new(lanes, epilogue, tile.frame, columns);
                let at = number * n + channel;
                let mut columns = [[lanes.splat_f32s(0.0); SIDE]; SIDE];
                for (x, column) in columns.iter_mut().enumerate() {
                    for (y, product) in column.iter_mut().enumerate() {
                        *product = load(lanes, &products[(SIDE * y + x) * step + at..]);
                    }
                    of_products(lanes, column);
                }
                for y in 0..SIDE - 2 {
                    let mut values = [lanes.splat_f32s(0.0); SIDE];
                    for (value, column) in values.iter_mut().zip(&columns) {
                        *value = column[y];
                    }
                    of_products(lanes, &mut values);
                    for (x, &value) in values[..SIDE - 2].iter().enumerate() {
                        if y >= tile.extent[0] || x >= tile.extent[1] {
                            continue;
                        }
                        let pixel = tile.pixel + y * to.size[2] + x;
                        let out = &mut target[places[pixel] - origin + channel..];
                        let mut stored = lanes.splat_f32s(0.0);
                        if finish.accumulate {
                            stored = load(lanes, out);
                        }
                        let ended = finish.apply_to(lanes, arithmetic, 0, value, stored);
                        store(lanes, ended, out);
                    }
                }
            }
        }
    }
}

/// Writes a vector to the beginning of a slice that holds one.
#[inline(always)]
fn store<S: Lanes>(_: S, vector: S::f32s, to: &mut [f32]) {
    S::as_mut_simd_f32s(&mut to[..S::F32_LANES]).0[0] = vector;
}
