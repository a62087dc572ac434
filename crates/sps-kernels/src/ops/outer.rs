//! Sums of outer products: the gradient of a matrix.

use std::borrow::Cow;
use std::ops::Range;

use sps_base::parallel;

use super::simd::{Lanes, Level};
use super::unroll::{tallest, tiles};
use super::words::{Arithmetic, Real, WordKernel, lanes_of};

/// Pixels of a gradient, and the places of a source that they belong to.
#[derive(Clone, Copy)]
pub(super) struct Pairs<'a, W> {
    pub(super) source: &'a [W],
    /// Where each place begins.
    pub(super) starts: &'a [usize],
    pub(super) gradient: &'a [W],
    /// Where each pixel begins.
    pub(super) places: &'a [usize],
}

/// Rows of a feature map as the left of [`Outer`]: of words that hold several numbers, as many rows joined, of
/// each column a word.
#[derive(Debug)]
pub(crate) struct Joined<'a, W: Real = f32> {
    memory: Cow<'a, [W]>,
    /// Where those that are joined begin.
    rows: Cow<'a, [usize]>,
}

/// Rows that one thread joins.
const TOGETHER: usize = 512;

impl<'a, W: Real> Joined<'a, W> {
    /// `width` numbers of each of the rows that begin so.
    pub(crate) fn new(level: Level, memory: &'a [W], rows: &'a [usize], width: usize) -> Self {
        if W::NUMBERS == 1 {
            return Self {
                memory: Cow::Borrowed(memory),
                rows: Cow::Borrowed(rows),
            };
        }
        let mut joined = vec![W::default(); rows.len().div_ceil(W::NUMBERS) * width];
        let parts = joined.chunks_mut(TOGETHER / W::NUMBERS * width.max(1));
        let parts = parts.zip(rows.chunks(TOGETHER));
        parallel::each(parts, |(out, rows)| {
            level.run(
                #[inline(always)]
                move || join(memory, rows, (width, width), out),
            );
        });
        Self {
            rows: (0..joined.len()).step_by(width.max(1)).collect(),
            memory: Cow::Owned(joined),
        }
    }

    /// The memory from a column on, and where those of some rows begin in it: a multiple of what is joined, but
    /// for the last ones.
    pub(crate) fn of(&self, column: usize, rows: Range<usize>) -> (&[W], &[usize]) {
        debug_assert!(rows.start.is_multiple_of(W::NUMBERS), "{rows:?}");
        let rows = rows.start / W::NUMBERS..rows.end.div_ceil(W::NUMBERS);
        (&self.memory[column..], &self.rows[rows])
    }
}

/// Joins so many numbers of rows two by two, into rows of so many words; where there are none stand zeros.
#[inline(always)]
pub(super) fn join<W: Real>(
    memory: &[W],
    rows: &[usize],
    (width, words): (usize, usize),
    joined: &mut [W],
) {
    let number = |row: usize| &W::each(&memory[row..])[..width];
    for (pair, out) in joined.chunks_exact_mut(words).enumerate() {
        let (own, beyond) = out.split_at_mut(width);
        beyond.fill(W::default());
        match rows.get(2 * pair..) {
            Some(&[one, other, ..]) => {
                let both = number(one).iter().zip(number(other));
                for (word, (&one, &other)) in own.iter_mut().zip(both) {
                    *word = W::gathered(|i| [one, other][i]);
                }
            }
            Some(&[one]) => {
                for (word, &one) in own.iter_mut().zip(number(one)) {
                    *word = W::gathered(|i| if i == 0 { one } else { W::narrowed(0.0) });
                }
            }
            _ => own.fill(W::default()),
        }
    }
}

/// `sum_m left[m]^T right[m]` for rows gathered from two feature maps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outer<'a, W = f32> {
    /// Memory as [`Joined`] has it, and where each row of the left begins.
    pub(crate) left: (&'a [W], &'a [usize]),
    /// Memory, and where each row of the right begins.
    pub(crate) right: (&'a [W], &'a [usize]),
    /// Numbers of a row of the left: rows of the sum.
    pub(crate) height: usize,
    /// Numbers of a row of the right: columns of the sum. Of words that hold several, whole words.
    pub(crate) width: usize,
}

impl<W: Real> Outer<'_, W> {
    /// How far rows of so many sums must lie apart at least.
    pub(crate) fn stride(level: Level, width: usize) -> usize {
        if W::NUMBERS == 1 {
            width
        } else {
            width.next_multiple_of(2 * level.lanes())
        }
    }

    /// Adds the sum, `(height, width)`, to rows of `target` that lie `stride` apart, each number where
    /// [`Real::place`] says.
    pub(crate) fn add(&self, level: Level, target: &mut [f32], stride: usize) {
        let add = Add {
            outer: self,
            target,
            stride,
        };
        W::run(level, add);
    }
}

struct Add<'a, 'b, W> {
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
                    with_height!(rows, S, H => self.tile::<S, A, H, 2, true>(lanes, arithmetic, tile));
                } else if const { W::NUMBERS > 1 } || columns > S::F32_LANES {
                    with_height!(rows, S, H => self.tile::<S, A, H, 2, false>(lanes, arithmetic, tile));
                } else if columns == S::F32_LANES {
                    with_height!(rows, S, H => self.tile::<S, A, H, 1, true>(lanes, arithmetic, tile));
                } else {
                    with_height!(rows, S, H => self.tile::<S, A, H, 1, false>(lanes, arithmetic, tile));
                }
            }
            column += columns;
        }
    }
}

impl<W: Real> Add<'_, '_, W> {
    /// Adds a tile of `H` rows and `NV` vectors, from a row and a column on, so many columns; `WHOLE` if those fill the
    /// vectors.
    #[inline(always)]
    fn tile<S, A, const H: usize, const NV: usize, const WHOLE: bool>(
        &mut self,
        lanes: S,
        arithmetic: A,
        (row, column, columns): (usize, usize, usize),
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        arithmetic.apart(
            lanes,
            #[inline(always)]
            move || {
                let outer = *self.outer;
                let ((left, left_rows), (right, right_rows)) = (outer.left, outer.right);
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
                let whole = const { WHOLE || W::NUMBERS > 1 };
                let kept = if whole { NV * S::F32_LANES } else { columns };
                each_row!(H, i, {
                    let start = (row + i) * self.stride + column;
                    let target = &mut self.target[start..start + kept];
                    if whole {
                        for (sum, target) in sums[i].into_iter().zip(S::as_mut_simd_f32s(target).0)
                        {
                            *target = lanes.add_f32s(sum, *target);
                        }
                    } else {
                        for (sum, target) in
                            sums[i].into_iter().zip(target.chunks_mut(S::F32_LANES))
                        {
                            let sum = lanes.add_f32s(sum, lanes.partial_load_f32s(target));
                            lanes.partial_store_f32s(target, sum);
                        }
                    }
                });
            },
        );
    }
}
