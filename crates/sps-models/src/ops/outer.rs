//! Sums of outer products: the gradient of a matrix.

use super::simd::{Lanes, Level, NullaryFnOnce};
use super::unroll::{tallest, tiles};
use super::words::{Arithmetic, Real, WordKernel, lanes_of};

/// `sum_m left[m]^T right[m]` for rows gathered from two feature maps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outer<'a, W = f32> {
    pub(crate) left: &'a [W],
    /// Where each row of the left begins.
    pub(crate) left_rows: &'a [usize],
    pub(crate) right: &'a [W],
    /// Where each row of the right begins.
    pub(crate) right_rows: &'a [usize],
    /// Numbers of a row of the left: rows of the sum.
    pub(crate) height: usize,
    /// Numbers of a row of the right: columns of the sum.
    pub(crate) width: usize,
}

impl<W: Real> Outer<'_, W> {
    /// Adds the sum, `(height, width)`, to rows of `target` that lie `stride` apart. Of words that hold
    /// several numbers, both fill whole words.
    pub(crate) fn add(&self, level: Level, target: &mut [f32], stride: usize) {
        let (joined, rows): (Vec<W>, Vec<usize>);
        let mut outer: Outer<'_, W> = *self;
        if W::NUMBERS > 1 {
            joined = self.joined();
            rows = (0..joined.len()).step_by(self.height.max(1)).collect();
            (outer.left, outer.left_rows) = (&joined, &rows);
        }
        W::run(
            level,
            Add {
                outer: &outer,
                target,
                stride,
            },
        );
    }

    /// The left with as many rows joined as a word has numbers: of each column a word. A row that is not
    /// there counts as 0.
    fn joined(&self) -> Vec<W> {
        let pairs = self.left_rows.chunks(W::NUMBERS);
        let mut joined = vec![W::default(); pairs.len() * self.height];
        let nothing = vec![W::default(); W::words(self.height)];
        for (joined, rows) in joined.chunks_exact_mut(self.height.max(1)).zip(pairs) {
            let first = W::each(&self.left[rows[0]..]);
            let second = rows.get(1).map_or(&nothing[..], |&row| &self.left[row..]);
            for ((word, &first), &second) in joined.iter_mut().zip(first).zip(W::each(second)) {
                *word = W::joined(first, second);
            }
        }
        joined
    }
}

struct Add<'a, 'b, W> {
    /// Rows of the left are joined.
    outer: &'a Outer<'b, W>,
    target: &'a mut [f32],
    stride: usize,
}

impl<W: Real> WordKernel<W> for Add<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(mut self, lanes: S, arithmetic: A) {
        let Outer { height, width, .. } = *self.outer;
        let mut column = 0;
        while column < width {
            let columns = (width - column).min(2 * S::F32_LANES);
            for (row, rows) in tiles(0, height, tallest::<S>()) {
                let tile = (row, column, columns);
                if columns == 2 * S::F32_LANES {
                    with_height!(rows, S, H => self.apart::<S, A, H, 2, true>(lanes, arithmetic, tile));
                } else if const { W::NUMBERS > 1 } || columns > S::F32_LANES {
                    with_height!(rows, S, H => self.apart::<S, A, H, 2, false>(lanes, arithmetic, tile));
                } else if columns == S::F32_LANES {
                    with_height!(rows, S, H => self.apart::<S, A, H, 1, true>(lanes, arithmetic, tile));
                } else {
                    with_height!(rows, S, H => self.apart::<S, A, H, 1, false>(lanes, arithmetic, tile));
                }
            }
            column += columns;
        }
    }
}

/// Rows from the first number, as many columns as the third says from the second.
type Corner = (usize, usize, usize);

/// A tile of `H` rows and `NV` vectors to be added.
struct SizedTile<'a, 'b, 'c, S, A, W, const H: usize, const NV: usize, const WHOLE: bool> {
    add: &'a mut Add<'b, 'c, W>,
    lanes: S,
    arithmetic: A,
    tile: Corner,
}

impl<S, A, W, const H: usize, const NV: usize, const WHOLE: bool> NullaryFnOnce
    for SizedTile<'_, '_, '_, S, A, W, H, NV, WHOLE>
where
    S: Lanes,
    A: Arithmetic<S, Word = W>,
    W: Real,
{
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.add
            .tile::<S, A, H, NV, WHOLE>(self.lanes, self.arithmetic, self.tile);
    }
}

impl<W: Real> Add<'_, '_, W> {
    #[inline(always)]
    fn apart<S, A, const H: usize, const NV: usize, const WHOLE: bool>(
        &mut self,
        lanes: S,
        arithmetic: A,
        tile: Corner,
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        arithmetic.apart(
            lanes,
            SizedTile::<S, A, W, H, NV, WHOLE> {
                add: self,
                lanes,
                arithmetic,
                tile,
            },
        );
    }

    /// Rows from `row`, `columns` columns from `column`; `WHOLE` if they fill the vectors.
    #[inline(always)]
    fn tile<S, A, const H: usize, const NV: usize, const WHOLE: bool>(
        &mut self,
        lanes: S,
        arithmetic: A,
        (row, column, columns): Corner,
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let Outer {
            left,
            left_rows,
            right,
            right_rows,
            ..
        } = *self.outer;
        let right = &right[W::words(column)..];
        let mut sums = [[lanes.splat_f32s(0.0); NV]; H];
        for (&l, r) in left_rows.iter().zip(right_rows.chunks(W::NUMBERS)) {
            let x = &lanes_of(&left[l + row..])[..H];
            let y = W::columns::<S, NV, WHOLE>(lanes, right, r, columns);
            for i in 0..H {
                let x = lanes.splat_f32s(x[i]);
                for v in 0..NV {
                    sums[i][v] = arithmetic.multiply_add(lanes, x, y[v], sums[i][v]);
                }
            }
        }
        each_row!(H, i, {
            let start = (row + i) * self.stride + column;
            let target = &mut self.target[start..start + columns];
            W::add_columns::<S, NV, WHOLE>(lanes, sums[i], target);
        });
    }
}
