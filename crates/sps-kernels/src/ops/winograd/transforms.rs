//! Tiles of feature maps, and weights, on their way through [`super::points`].

use super::points::{of_gradients, of_inputs, of_products, of_weights};
use super::{Reach, Tile};
use crate::ops::product::{Epilogue, Finish};
use crate::ops::simd::{Kernel, Lanes, load};
use crate::ops::words::{Arithmetic, Word, WordKernel};

/// `G g G^T` of each pair of channels.
pub(super) struct TransformWeights<'a, 'b, const SIDE: usize> {
    pub(super) panel: &'a [f32],
    pub(super) products: &'a mut [&'b mut [f32]],
    /// Numbers of each tap.
    pub(super) tap: usize,
    pub(super) turned: bool,
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
pub(super) struct TransformInputs<'a, W, const SIDE: usize> {
    pub(super) reach: &'a Reach<'a, W>,
    pub(super) tiles: &'a [Tile],
    pub(super) times: usize,
    /// Channels.
    pub(super) run: usize,
    /// `(products, times, tiles, channels)`
    pub(super) target: &'a mut [f32],
}

impl<W: Word, const SIDE: usize> WordKernel<W> for TransformInputs<'_, W, SIDE> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(self, lanes: S, arithmetic: A) {
        let (tiles, times, run) = (self.tiles, self.times, self.run);
        let (reach, from) = (*self.reach, self.reach.from);
        let (row, pitch) = (from.extent(2) * from.pitch, from.pitch);
        let step = times * tiles.len() * run;
        for time in 0..times {
            for (number, tile) in tiles.iter().enumerate() {
                let start = reach.starts[tile.pixel] + time * from.extent(1) * row;
                // Behind the last row and column that its outputs need there may be none.
                let [last_row, last_column] = tile.extent.map(|extent| extent + 1);
                let end = start + last_row * row + last_column * pitch + W::words(run);
                let inputs = &reach.source[start..end];
                let first = (time * tiles.len() + number) * run;
                for channel in (0..run).step_by(S::F32_LANES) {
                    let mut columns = [[lanes.splat_f32s(0.0); SIDE]; SIDE];
                    for (x, column) in columns.iter_mut().enumerate() {
                        let at = x.min(last_column) * pitch + W::words(channel);
                        for (y, input) in column.iter_mut().enumerate() {
                            let from = &inputs[y.min(last_row) * row + at..];
                            [*input] = arithmetic.load(lanes, from);
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
                            store(lanes, value, &mut self.target[at..]);
                        }
                    }
                }
            }
        }
    }
}

/// `A^T m A` of each tile and channel, and what happens to sums.
pub(super) struct TransformOutputs<'a, W, const SIDE: usize> {
    pub(super) reach: &'a Reach<'a, W>,
    pub(super) tiles: &'a [Tile],
    /// Channels.
    pub(super) n: usize,
    /// `(products, tiles, channels)`
    pub(super) products: &'a [f32],
    pub(super) target: &'a mut [W],
    pub(super) origin: usize,
    pub(super) epilogue: Epilogue<'a>,
}

impl<W: Word, const SIDE: usize> WordKernel<W> for TransformOutputs<'_, W, SIDE> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(self, lanes: S, arithmetic: A) {
        let (reach, tiles, n) = (*self.reach, self.tiles, self.n);
        let step = tiles.len() * n;
        for (number, tile) in tiles.iter().enumerate() {
            for channel in (0..n).step_by(S::F32_LANES) {
                let columns = (channel, S::F32_LANES);
                let finish = Finish::<S, 1>::new(lanes, self.epilogue, tile.frame, columns);
                let at = number * n + channel;
                let mut columns = [[lanes.splat_f32s(0.0); SIDE]; SIDE];
                for (x, column) in columns.iter_mut().enumerate() {
                    for (y, product) in column.iter_mut().enumerate() {
                        *product = load(lanes, &self.products[(SIDE * y + x) * step + at..]);
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
                        let pixel = tile.pixel + y * reach.to.size[2] + x;
                        let out = reach.places[pixel] - self.origin + W::words(channel);
                        let out = &mut self.target[out..][..W::words(S::F32_LANES)];
                        finish.store::<A, true, 2>(lanes, arithmetic, [value], out);
                    }
                }
            }
        }
    }
}

/// `A y A^T` of each tile and channel of an output's gradient, by tiles of 2 x 2.
pub(super) struct TransformGradients<'a> {
    pub(super) reach: &'a Reach<'a>,
    pub(super) gradient: &'a [f32],
    pub(super) tiles: &'a [Tile],
    /// Channels.
    pub(super) n: usize,
    /// `(products, tiles, channels)`
    pub(super) target: &'a mut [f32],
}

impl Kernel for TransformGradients<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) {
        let reach = *self.reach;
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
                            let place = reach.places[tile.pixel + y * reach.to.size[2] + x];
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

/// Writes a vector to the beginning of a slice that holds one.
#[inline(always)]
fn store<S: Lanes>(_: S, vector: S::f32s, to: &mut [f32]) {
    S::as_mut_simd_f32s(&mut to[..S::F32_LANES]).0[0] = vector;
}
