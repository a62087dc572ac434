//! Embeddings of windows of an image, from one pass through the network.

use std::ops::Range;

use sps_base::parallel;

use crate::error::{Error, Result};
use crate::inference::Scale;
use crate::ops::grid::Grid;
use crate::ops::words::Word;

/// Embeddings of windows that lie on a regular grid over an image.
#[derive(Debug, Clone, PartialEq)]
pub struct WindowEmbeddings {
    /// Windows from the image's top to its bottom.
    pub rows: usize,
    /// Windows from its left to its right.
    pub columns: usize,
    /// `(rows * columns, width)`, row-major.
    pub embeddings: Vec<f32>,
    /// The centre of each window, `(rows * columns)`: pixels down and to the right from the image's
    /// upper left corner.
    pub centres: Vec<[f64; 2]>,
}

/// Values that embeddings of windows may have together: a gibibyte.
const MOST_VALUES: usize = 1 << 28;

/// Windows of one extent on a regular grid over an image, in pixels.
#[derive(Debug, Clone, Copy)]
pub struct Windows {
    /// Height and width of the image.
    image: [usize; 2],
    window: [usize; 2],
    stride: usize,
}

impl Windows {
    /// Takes height and width of an image and of the windows, and the stride of the grid.
    ///
    /// # Errors
    /// A window of no pixel or larger than the image, a stride of 0.
    pub fn new(image: [usize; 2], window: [usize; 2], stride: usize) -> Result<Self> {
        if (0..2).any(|axis| window[axis] == 0 || window[axis] > image[axis]) {
            let expected = format_args!("1 to {image:?}, the image's");
            return Err(Error::input("window", format_args!("{window:?}"), expected));
        }
        if stride == 0 {
            return Err(Error::input("stride of windows", stride, "at least 1"));
        }
        Ok(Self {
            image,
            window,
            stride,
        })
    }

    /// How many there are from the image's top to its bottom, and from its left to its right.
    pub fn counts(&self) -> [usize; 2] {
        [0, 1].map(|axis| (self.image[axis] - self.window[axis]) / self.stride + 1)
    }

    /// The upper left corner of each, row by row: pixels down and to the right from the image's.
    pub fn corners(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        let row = |y| self.starts(1).map(move |x| [y, x]);
        self.starts(0).flat_map(row)
    }

    /// The centre of each, as [`Windows::corners`].
    pub fn centres(&self) -> Vec<[f64; 2]> {
        let [height, width] = self.window.map(|side| side as f64 / 2.0);
        let centre = |[y, x]: [usize; 2]| [y as f64 + height, x as f64 + width];
        self.corners().map(centre).collect()
    }

    /// Where the windows begin along an axis.
    fn starts(&self, axis: usize) -> impl Iterator<Item = usize> {
        let stride = self.stride;
        (0..self.counts()[axis]).map(move |at| at * stride)
    }

    /// The cells of each window along an axis of so many cells: those whose centres lie in it.
    fn cells(&self, axis: usize, count: usize) -> Result<Vec<Range<usize>>> {
        let (extent, window) = (self.image[axis], self.window[axis]);
        if window * count < extent {
            let found = format_args!("{} {window}", ["height", "width"][axis]);
            let least = extent.div_ceil(count);
            let expected = format_args!("at least {least}, one cell of the feature map");
            return Err(Error::input("window", found, expected));
        }
        // The centre of cell `i` is at `(2i + 1) extent / 2 count`; this many are before `pixel`.
        let doubled = |pixel: usize| (2 * pixel * count).saturating_sub(extent);
        let before = |pixel: usize| doubled(pixel).div_ceil(2 * extent);
        let cells = |start: usize| before(start)..before(start + window);
        Ok(self.starts(axis).map(cells).collect())
    }

    /// The mean of the cells of each window, at each depth. A feature map of `n` rows cuts the image into `n` rows
    /// of one height, and a cell's centre is that of its piece; so with columns. The cells of a window are those whose
    /// centres lie in it.
    ///
    /// # Errors
    /// Windows smaller than a cell, some of which would hold none, and more of them than a gibibyte
    /// holds.
    pub fn embed(&self, depths: &[CellSums]) -> Result<WindowEmbeddings> {
        let cells = |sums: &CellSums| Ok([self.cells(0, sums.rows)?, self.cells(1, sums.columns)?]);
        let cells = depths.iter().map(cells).collect::<Result<Vec<_>>>()?;
        let [rows, columns] = self.counts();
        let width: usize = depths.iter().map(|sums| sums.width).sum();
        let values = rows.saturating_mul(columns).saturating_mul(width);
        if values > MOST_VALUES {
            let found = format_args!("{rows} x {columns} of width {width}");
            let expected = format_args!("at most {MOST_VALUES} values; a larger stride");
            return Err(Error::input("windows", found, expected));
        }
        let mut embeddings = vec![0.0; values];
        let outs = embeddings.chunks_mut((columns * width).max(1)).enumerate();
        parallel::each(outs, |(row, out)| {
            for (column, mut out) in out.chunks_exact_mut(width).enumerate() {
                for (sums, [rows, columns]) in depths.iter().zip(&cells) {
                    let (block, rest) = out.split_at_mut(sums.width);
                    sums.mean(&rows[row], &columns[column], block);
                    out = rest;
                }
            }
        });
        Ok(WindowEmbeddings {
            rows,
            columns,
            centres: self.centres(),
            embeddings,
        })
    }
}

/// The sums of a feature map over all rectangles that begin at its first cell, from which that over
/// any rectangle is known (Crow, "Summed-area tables for texture mapping", SIGGRAPH 1984).
#[derive(Debug)]
pub struct CellSums {
    rows: usize,
    columns: usize,
    width: usize,
    /// `(rows + 1, columns + 1, width)`; f64, in which a difference of sums keeps an f32's digits.
    sums: Vec<f64>,
}

impl CellSums {
    /// Of the one frame of a feature map of an image, whose numbers stand for what `scale` says.
    pub(crate) fn new<W: Word>(features: &[W], grid: &Grid, scale: Scale) -> Self {
        let ([_, rows, columns], width) = (grid.size, grid.channels);
        let line = (columns + 1) * width;
        let mut sums = vec![0.0; (rows + 1) * line];
        let places = grid.places();
        let mut cells = places.iter().map(|&place| &features[place..][..grid.words]);
        for row in 0..rows {
            let (above, below) = sums[row * line..].split_at_mut(line);
            let mut of_row = vec![0.0; width];
            let corners = above.chunks_exact(width).zip(below.chunks_exact_mut(width));
            for ((above, below), cell) in corners.skip(1).zip(&mut cells) {
                let numbers = of_row.iter_mut().zip(W::numbers(cell));
                for ((sum, x), (above, below)) in numbers.zip(above.iter().zip(below)) {
                    *sum += f64::from(scale.value(x));
                    *below = above + *sum;
                }
            }
        }
        Self {
            rows,
            columns,
            width,
            sums,
        }
    }

    /// The sums over the cells before a row and a column.
    fn before(&self, row: usize, column: usize) -> &[f64] {
        let at = (row * (self.columns + 1) + column) * self.width;
        &self.sums[at..at + self.width]
    }

    /// The mean over a rectangle of cells.
    fn mean(&self, rows: &Range<usize>, columns: &Range<usize>, out: &mut [f32]) {
        let count = (rows.len() * columns.len()) as f64;
        let [upper, lower] = [rows.start, rows.end].map(|row| {
            let [left, right] = [columns.start, columns.end].map(|c| self.before(row, c));
            left.iter().zip(right)
        });
        for ((out, upper), lower) in out.iter_mut().zip(upper).zip(lower) {
            let sum = (lower.1 - lower.0) - (upper.1 - upper.0);
            *out = (sum / count) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::golden::uniform;

    mod hard_cases {
        use super::*;

        #[test]
        fn a_bright_cell_does_not_drown_the_windows_after_it() {
            const SIDE: usize = 40;
            const DARK: f32 = 1.0 / 1024.0;
            let mut map = [DARK; SIDE * SIDE];
            map[0] = 1e6;
            let grid = Grid::tight(1, [1, SIDE, SIDE], 1);
            let windows = Windows::new([SIDE; 2], [1, 1], 1).unwrap();
            let sums = CellSums::new(&map, &grid, Scale::UNIT);
            let found = windows.embed(&[sums]).unwrap();
            let off = |value: f32| (value / DARK - 1.0).abs();
            let others = found.embeddings[1..].iter();
            let worst = others.fold(0.0_f32, |m, &v| m.max(off(v)));
            println!("windows after a bright cell: error {worst:.1e}, bound 1e-7");
            assert!(worst <= 1e-7);
            let sums = [1, 2].map(|cells| map[..=cells].iter().sum::<f32>());
            assert!(off(sums[1] - sums[0]) > 1e-7, "the naive form");
        }
    }

    proptest! {
        /// Each window's mean is that over the cells whose centres lie in it, one by one.
        #[test]
        fn means_are_those_of_the_cells_in_the_window(
            cells in [1_usize..9, 1_usize..9],
            finer in [0_usize..60, 0_usize..60],
            share in [0.0_f64..1.0, 0.0_f64..1.0],
            stride in 1_usize..30,
        ) {
            let width = 3;
            let image = [0, 1].map(|axis| cells[axis] + finer[axis]);
            let window = [0, 1].map(|axis| {
                let least = image[axis].div_ceil(cells[axis]);
                least + ((image[axis] - least) as f64 * share[axis]) as usize
            });
            let map = uniform("windows", cells[0] * cells[1] * width);
            let map: Vec<f32> = map.iter().map(|&x| x as f32).collect();
            let grid = Grid::tight(1, [1, cells[0], cells[1]], width);
            let windows = Windows::new(image, window, stride).unwrap();
            let found = windows.embed(&[CellSums::new(&map, &grid, Scale::UNIT)]).unwrap();

            let lasts = [0, 1].map(|axis| image[axis] - window[axis]);
            let mut at = 0;
            for y in (0..=lasts[0]).step_by(stride) {
                for x in (0..=lasts[1]).step_by(stride) {
                    let centre = [(y, window[0]), (x, window[1])];
                    let centre = centre.map(|(start, side)| start as f64 + side as f64 / 2.0);
                    prop_assert_eq!(found.centres[at], centre);
                    // Twice the number of cells times a cell's centre, in whole numbers.
                    let holds = |axis: usize, start: usize, cell: usize| {
                        let scaled = (2 * cell + 1) * image[axis];
                        let [from, to] = [start, start + window[axis]].map(|p| 2 * cells[axis] * p);
                        (from..to).contains(&scaled)
                    };
                    let mut sums = vec![0.0; width];
                    let mut count = 0;
                    for (cell, values) in map.chunks(width).enumerate() {
                        let (row, column) = (cell / cells[1], cell % cells[1]);
                        if holds(0, y, row) && holds(1, x, column) {
                            count += 1;
                            sums.iter_mut().zip(values).for_each(|(s, v)| *s += f64::from(*v));
                        }
                    }
                    for (channel, sum) in sums.iter().enumerate() {
                        let found = f64::from(found.embeddings[at * width + channel]);
                        prop_assert!((found - sum / f64::from(count)).abs() < 1e-7);
                    }
                    at += 1;
                }
            }
            prop_assert_eq!(at, found.rows * found.columns);
        }
    }
}
