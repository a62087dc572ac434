//! Sums of outer products: the gradient of a matrix.

use super::simd::{Kernel, Lanes, Level, NullaryFnOnce};
use super::unroll::{tallest, tiles};

/// `sum_m left[m]^T right[m]` for rows gathered from two feature maps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outer<'a> {
    pub(crate) left: &'a [f32],
    /// Where each row of the left begins.
    pub(crate) left_rows: &'a [usize],
    pub(crate) right: &'a [f32],
    /// Where each row of the right begins.
    pub(crate) right_rows: &'a [usize],
    /// Elements of a row of the left: rows of the sum.
    pub(crate) height: usize,
    /// Elements of a row of the right: columns of the sum.
    pub(crate) width: usize,
}

impl Outer<'_> {
    /// Adds the sum, `(height, width)`, to rows of `target` that lie `stride` apart.
    pub(crate) fn add(&self, level: Level, target: &mut [f32], stride: usize) {
        level.run(Add {
            outer: self,
            target,
            stride,
        });
    }
}

struct Add<'a, 'b> {
    outer: &'a Outer<'b>,
    target: &'a mut [f32],
    stride: usize,
}

impl Kernel for Add<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(mut self, lanes: S) {
        let Outer { height, width, .. } = *self.outer;
        let mut column = 0;
        while column < width {
            let columns = (width - column).min(2 * S::F32_LANES);
            for (row, rows) in tiles(0, height, tallest::<S>()) {
                let tile = (row, column, columns);
                if columns == 2 * S::F32_LANES {
                    with_height!(rows, S, H => self.apart::<S, H, 2, true>(lanes, tile));
                } else if columns > S::F32_LANES {
                    with_height!(rows, S, H => self.apart::<S, H, 2, false>(lanes, tile));
                } else if columns == S::F32_LANES {
                    with_height!(rows, S, H => self.apart::<S, H, 1, true>(lanes, tile));
                } else {
                    with_height!(rows, S, H => self.apart::<S, H, 1, false>(lanes, tile));
                }
            }
            column += columns;
        }
    }
}

/// Rows from the first number, as many columns as the third says from the second.
type Corner = (usize, usize, usize);

/// A tile of `H` rows and `NV` vectors to be added.
struct SizedTile<'a, 'b, 'c, S, const H: usize, const NV: usize, const WHOLE: bool> {
    add: &'a mut Add<'b, 'c>,
    lanes: S,
    tile: Corner,
}

impl<S: Lanes, const H: usize, const NV: usize, const WHOLE: bool> NullaryFnOnce
    for SizedTile<'_, '_, '_, S, H, NV, WHOLE>
{
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.add.tile::<S, H, NV, WHOLE>(self.lanes, self.tile);
    }
}

impl Add<'_, '_> {
    #[inline(always)]
    fn apart<S: Lanes, const H: usize, const NV: usize, const WHOLE: bool>(
        &mut self,
        lanes: S,
        tile: Corner,
    ) {
        lanes.apart(SizedTile::<S, H, NV, WHOLE> {
            add: self,
            lanes,
            tile,
        });
    }

    /// Rows from `row`, `columns` columns from `column`; `WHOLE` if they fill the vectors.
    #[inline(always)]
    fn tile<S: Lanes, const H: usize, const NV: usize, const WHOLE: bool>(
        &mut self,
        lanes: S,
        (row, column, columns): Corner,
    ) {
        let Outer {
            left,
            left_rows,
            right,
            right_rows,
            ..
        } = *self.outer;
        let mut sums = [[lanes.splat_f32s(0.0); NV]; H];
        for (&l, &r) in left_rows.iter().zip(right_rows) {
            let l = l + row;
            let x = &left[l..l + H];
            let r = r + column;
            let y = vectors::<S, NV, WHOLE>(lanes, &right[r..r + columns]);
            for i in 0..H {
                let x = lanes.splat_f32s(x[i]);
                for v in 0..NV {
                    sums[i][v] = lanes.fma(x, y[v], sums[i][v]);
                }
            }
        }
        each_row!(H, i, {
            let start = (row + i) * self.stride + column;
            let target = &mut self.target[start..start + columns];
            if WHOLE {
                for (v, part) in S::as_mut_simd_f32s(target).0.iter_mut().enumerate() {
                    *part = lanes.add_f32s(sums[i][v], *part);
                }
            } else {
                for (v, part) in target.chunks_mut(S::F32_LANES).enumerate() {
                    let sum = lanes.add_f32s(sums[i][v], lanes.partial_load_f32s(part));
                    lanes.partial_store_f32s(part, sum);
                }
            }
        });
    }
}

#[inline(always)]
fn vectors<S: Lanes, const NV: usize, const WHOLE: bool>(lanes: S, from: &[f32]) -> [S::f32s; NV] {
    std::array::from_fn(|v| {
        if WHOLE {
            S::as_simd_f32s(from).0[v]
        } else {
            let from = &from[(v * S::F32_LANES).min(from.len())..];
            lanes.partial_load_f32s(&from[..from.len().min(S::F32_LANES)])
        }
    })
}
