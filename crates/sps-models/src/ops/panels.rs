//! The right operand of a product, laid out for the kernel.

use rayon::prelude::*;

use super::buffer::Buffer;
use super::simd::Level;
use super::words::Word;

/// Vectors of a panel's row.
pub(super) const PANEL_VECTORS: usize = 2;

/// Rows whose cache lines a transposition holds at once.
const BLOCK: usize = 64;

/// A matrix of words `(k, n)` cut into panels of columns: each panel is stored row by row, so that
/// the kernel reads it from front to back.
///
/// A panel is [`PANEL_VECTORS`] vectors wide; the last one is a single vector wide where that is
/// enough. Columns beyond `n` are zero.
#[derive(Debug, Clone)]
pub(crate) struct Panels<W = f32> {
    level: Level,
    k: usize,
    n: usize,
    data: Buffer<W>,
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

impl<W: Word> Panels<W> {
    /// Packs the matrix whose element `(row, column)` is `element(row, column)`.
    pub(crate) fn pack(
        level: Level,
        k: usize,
        n: usize,
        element: impl Fn(usize, usize) -> W,
    ) -> Self {
        let mut panels = Self::empty(level);
        panels.gather(k, n, |row, column, out| {
            for (i, out) in out.iter_mut().enumerate() {
                *out = element(row, column + i);
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
        let (k, n, lanes) = (self.k, self.n, self.level.lanes());
        let mut panels = Vec::new();
        let mut rest: &mut [W] = &mut self.data;
        for (column, vectors) in columns(n, lanes) {
            let width = vectors * lanes;
            let (panel, tail) = rest.split_at_mut(k * width);
            panels.push((column, width, panel));
            rest = tail;
        }
        panels.into_par_iter().for_each(|(column, width, panel)| {
            fill(column, width.min(n - column), width, panel);
        });
    }

    /// No matrix yet.
    pub(crate) fn empty(level: Level) -> Self {
        Self {
            level,
            k: 0,
            n: 0,
            data: Buffer::zeros(0),
        }
    }

    /// Replaces the matrix by one whose row's elements from a column on `fill` writes; memory
    /// once taken is kept.
    pub(crate) fn gather(
        &mut self,
        k: usize,
        n: usize,
        mut fill: impl FnMut(usize, usize, &mut [W]),
    ) {
        let lanes = self.level.lanes();
        (self.k, self.n) = (k, n);
        self.data.resize(k * n.div_ceil(lanes) * lanes);
        for (column, vectors) in columns(n, lanes) {
            let width = vectors * lanes;
            // Panels before this one are `column` wide together.
            let panel = &mut self.data[k * column..k * (column + width)];
            for (row, out) in panel.chunks_exact_mut(width).enumerate() {
                let (own, beyond) = out.split_at_mut(width.min(n - column));
                fill(row, column, own);
                beyond.fill(W::zeroed());
            }
        }
    }

    /// The level whose vectors the panels are cut for.
    pub(crate) fn level(&self) -> Level {
        self.level
    }

    /// Rows.
    pub(crate) fn k(&self) -> usize {
        self.k
    }

    /// Columns.
    pub(crate) fn n(&self) -> usize {
        self.n
    }

    /// The panels from left to right.
    pub(super) fn iter(&self) -> impl Iterator<Item = Panel<'_, W>> {
        let lanes = self.level.lanes();
        let mut rest: &[W] = &self.data;
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
