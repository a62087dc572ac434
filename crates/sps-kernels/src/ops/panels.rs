//! The right operand of a product, laid out for the kernel.

use std::borrow::Cow;

use sps_base::parallel;

use super::bands::Threads;
use super::buffer::Buffer;
use super::grid::{Grid, pixels};
use super::simd::Level;
use super::words::{Word, lanes_of};

/// Vectors of a panel's row.
pub(super) const PANEL_VECTORS: usize = 2;

/// Rows whose cache lines a transposition holds at once.
const BLOCK: usize = 64;

/// Packing goes in blocks of so many words and columns, so that their cache lines stay: columns that lie far
/// apart often fall on few sets of the cache.
const NEAR: [usize; 2] = [16, 8];

/// A matrix of words `(k, n)` cut into panels of columns: each panel is stored row by row, so that
/// the kernel reads it from front to back.
///
/// A panel is [`PANEL_VECTORS`] vectors wide; the last one is a single vector wide where that is
/// enough. Columns beyond `n` are zero.
#[derive(Debug, Clone)]
pub(crate) struct Panels<W = f32> {
    /// The level whose vectors the panels are cut for.
    pub(super) level: Level,
    pub(super) k: usize,
    pub(super) n: usize,
    data: Buffer<W>,
}

/// Panels of a matrix that lie side by side: a matrix of their columns alone.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PanelRun<'a, W> {
    pub(super) level: Level,
    pub(super) k: usize,
    /// The first column in the whole matrix.
    pub(super) column: usize,
    pub(super) n: usize,
    data: &'a [W],
}

/// One panel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Panel<'a, W> {
    /// Its first column.
    pub(super) column: usize,
    /// Columns that are the matrix's own.
    pub(super) columns: usize,
    /// Vectors of a row.
    pub(super) vectors: usize,
    /// `(k, vectors * lanes)`.
    pub(super) data: &'a [W],
}

impl<W: Word> Panel<'_, W> {
    /// Its numbers: a row of `width` words becomes [`Word::NUMBERS`] rows.
    fn numbers(&self, width: usize) -> Cow<'_, [f32]> {
        if W::NUMBERS == 1 {
            return Cow::Borrowed(lanes_of(self.data));
        }
        let mut numbers = vec![0.0; self.data.len() * W::NUMBERS];
        let rows = numbers.chunks_exact_mut(width * W::NUMBERS);
        for (rows, words) in rows.zip(self.data.chunks_exact(width)) {
            for (column, number) in W::numbers(words).enumerate() {
                rows[column % W::NUMBERS * width + column / W::NUMBERS] = number;
            }
        }
        Cow::Owned(numbers)
    }
}

impl<W: Word> Panels<W> {
    /// Packs the matrix `(taps * words, n)` of `element(tap, word, column)`.
    pub(crate) fn pack(
        level: Level,
        [taps, words]: [usize; 2],
        n: usize,
        element: impl Fn(usize, usize, usize) -> W + Send + Sync,
    ) -> Self {
        let mut panels = Self::resized(level, taps * words, n);
        panels.for_each_panel(|column, columns, width, panel| {
            // A column's taps of one word lie side by side.
            let [near, beside] = NEAR;
            for from in (0..words).step_by(near) {
                let block = from..(from + near).min(words);
                for first in (0..columns).step_by(beside) {
                    let count = beside.min(columns - first);
                    for tap in 0..taps {
                        for word in block.clone() {
                            let row = &mut panel[(tap * words + word) * width + first..][..count];
                            for (i, out) in row.iter_mut().enumerate() {
                                *out = element(tap, word, column + first + i);
                            }
                        }
                    }
                }
            }
        });
        panels
    }

    /// Packs the transpose of a row-major matrix `(n, k)`.
    pub(crate) fn pack_transposed(level: Level, k: usize, n: usize, matrix: &[W]) -> Self {
        let mut panels = Self::resized(level, k, n);
        panels.for_each_panel(|column, columns, width, panel| {
            // Blocks of rows and columns whose cache lines are all at hand.
            for from in (0..k).step_by(BLOCK) {
                let to = (from + BLOCK).min(k);
                for i in 0..columns {
                    let row = &matrix[(column + i) * k..][from..to];
                    let out = panel[from * width + i..].iter_mut().step_by(width);
                    for (out, value) in out.zip(row) {
                        *out = *value;
                    }
                }
            }
        });
        panels
    }

    /// Packs a row-major matrix `(k, n)`.
    pub(crate) fn pack_rows(level: Level, k: usize, n: usize, matrix: &[W]) -> Self {
        let mut panels = Self::resized(level, k, n);
        panels.for_each_panel(|column, columns, width, panel| {
            for (out, row) in panel.chunks_exact_mut(width).zip(matrix.chunks_exact(n)) {
                out[..columns].copy_from_slice(&row[column..column + columns]);
            }
        });
        panels
    }

    /// Matrices of `k` rows and as many columns: `make` fills a panel of each from the same panel of this one.
    pub(super) fn derived(
        &self,
        threads: Threads,
        k: usize,
        count: usize,
        make: impl Fn(&[f32], &mut [&mut [f32]]) + Send + Sync,
    ) -> Vec<Panels> {
        let mut all = vec![Panels::resized(self.level, k, self.n); count];
        let lanes = self.level.lanes();
        let own = self.all();
        let mut made: Vec<_> = own.iter().map(|panel| (panel, Vec::new())).collect();
        for panels in &mut all {
            for ((_, parts), (.., memory)) in made.iter_mut().zip(panels.parts()) {
                parts.push(memory);
            }
        }
        let make = |(panel, mut parts): (Panel<'_, W>, Vec<_>)| {
            make(&panel.numbers(panel.vectors * lanes), &mut parts);
        };
        match threads {
            Threads::One => made.into_iter().for_each(make),
            Threads::All => parallel::each(made, make),
        }
        all
    }

    fn resized(level: Level, k: usize, n: usize) -> Self {
        let lanes = level.lanes();
        Self {
            level,
            k,
            n,
            data: Buffer::zeros(k * n.div_ceil(lanes) * lanes),
        }
    }

    /// Calls `fill` on the panels, in parallel: first column, columns, width, memory.
    fn for_each_panel(&mut self, fill: impl Fn(usize, usize, usize, &mut [W]) + Send + Sync) {
        let n = self.n;
        parallel::each(self.parts(), |(column, width, panel)| {
            fill(column, width.min(n - column), width, panel);
        });
    }

    /// First column, width and memory of each panel.
    fn parts(&mut self) -> Vec<(usize, usize, &mut [W])> {
        let (k, lanes) = (self.k, self.level.lanes());
        let mut parts = Vec::new();
        let mut rest = &mut self.data[..];
        for (column, vectors) in columns(self.n, lanes) {
            let width = vectors * lanes;
            let (panel, tail) = rest.split_at_mut(k * width);
            parts.push((column, width, panel));
            rest = tail;
        }
        parts
    }

    /// Whether the weights outweigh the maps that threads would read and copy if they shared out the columns.
    pub(crate) fn outweigh(&self, from: &Grid, to: &Grid) -> bool {
        let words = |grid: &Grid| grid.frames * pixels(grid.size) * grid.words;
        rayon::current_num_threads() > 1 && self.k * self.n > words(from) + 2 * words(to)
    }

    pub(crate) fn all(&self) -> PanelRun<'_, W> {
        PanelRun {
            level: self.level,
            k: self.k,
            column: 0,
            n: self.n,
            data: &self.data,
        }
    }
}

impl<'a, W: Word> PanelRun<'a, W> {
    /// Shorter runs of nearly one length, at most so many.
    pub(super) fn split(self, count: usize) -> Vec<Self> {
        let width = PANEL_VECTORS * self.level.lanes();
        let panels = self.n.div_ceil(width);
        let count = count.min(panels);
        let bound = |i: usize| (panels * i / count * width).min(self.n);
        let run = |i: usize| {
            let (from, to) = (bound(i), bound(i + 1));
            Self {
                column: self.column + from,
                n: to - from,
                data: &self.data[self.k * from..],
                ..self
            }
        };
        (0..count).map(run).collect()
    }

    /// The panels from left to right; columns are counted from the first of the run.
    pub(super) fn iter(self) -> impl Iterator<Item = Panel<'a, W>> {
        let lanes = self.level.lanes();
        let mut rest = self.data;
        columns(self.n, lanes).map(move |(column, vectors)| {
            let width = vectors * lanes;
            let (data, tail) = rest.split_at(self.k * width);
            rest = tail;
            Panel {
                column,
                columns: width.min(self.n - column),
                vectors,
                data,
            }
        })
    }
}

/// First column and number of vectors of each panel.
fn columns(n: usize, lanes: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n)
        .step_by(PANEL_VECTORS * lanes)
        .map(move |column| (column, (n - column).div_ceil(lanes).min(PANEL_VECTORS)))
}
