//! Sums of outer products by matrix tiles: the gradient of a matrix, of pixels two by two.
//!
//! A block of pixels of the right becomes panels, whose rows are pairs of pixels; one of the left becomes the same, turned
//! round. Their product joins a sum in f32.

use std::ops::Range;

use sps_base::parallel;

use super::bands::{chunks, on_all_threads};
use super::outer::{Pairs, join};
use super::simd::{Lanes, Level, TileKind};
use super::tiles::{HEIGHT, Left, Sums, Tiles, WIDTH, WORDS, compiled, sum};
use super::words::{Arithmetic, Real, WordKernel, lanes_of};

/// `sum_m left[m]^T right[m]` over pixels, of gradients on the left, for each run of the source on the right.
pub(super) struct OuterTiles<'a, W> {
    pub(super) kind: TileKind,
    pub(super) level: Level,
    pub(super) pairs: Pairs<'a, W>,
    /// Numbers of a pixel of the left.
    pub(super) height: usize,
    /// How far from a pixel's beginning each run of the right begins.
    pub(super) runs: &'a [usize],
    /// Numbers of a run.
    pub(super) width: usize,
}

/// Pairs of pixels whose products are summed before the sum joins a longer one.
const PAIRS: usize = 256;

/// Words from one row of a block of the left to the next: not all at the same places of the cache.
const PITCH: usize = PAIRS + WORDS;

/// Blocks of the left that are laid out at once.
const BLOCKS: usize = 16;

/// Sums that one thread computes: panels of a run, and all rows or some of them.
struct Part {
    run: usize,
    panels: Range<usize>,
    rows: Range<usize>,
    /// `(rows, panels, columns of a panel)`
    sums: Vec<f32>,
}

/// All sums.
pub(super) struct Parts {
    all: Vec<Part>,
    /// Parts of a run along its columns and along the rows.
    counts: [usize; 2],
    /// Rows of a part.
    rows: usize,
}

impl Parts {
    /// A row of the sums of a run, piece by piece; there may be more than its width.
    pub(super) fn row(&self, row: usize, run: usize) -> impl Iterator<Item = &[f32]> {
        let [across, down] = self.counts;
        let parts = self.all[run * across * down..].iter();
        let parts = parts.skip(row / self.rows).step_by(down).take(across);
        parts.map(move |part| {
            let len = part.sums.len() / part.rows.len();
            &part.sums[(row - part.rows.start) * len..][..len]
        })
    }
}

impl<W: Real> OuterTiles<'_, W> {
    pub(super) fn sums(&self) -> Parts {
        let columns = 2 * self.level.lanes();
        let height = self.height.next_multiple_of(2 * HEIGHT);
        let all = self.width.div_ceil(columns);
        let wanted = 2 * rayon::current_num_threads();
        let panels = all.div_ceil(wanted.div_ceil(self.runs.len())).max(1);
        let across = all.div_ceil(panels);
        let down = wanted.div_ceil(self.runs.len() * across);
        let rows = height.div_ceil(down).next_multiple_of(2 * HEIGHT);
        let counts = [across, height.div_ceil(rows)];
        let part = |i: usize| {
            let (down, i) = (i % counts[1], i / counts[1]);
            let (across, run) = (i % counts[0], i / counts[0]);
            let of_panels = across * panels..((across + 1) * panels).min(all);
            let of_rows = down * rows..((down + 1) * rows).min(height);
            Part {
                run,
                sums: vec![0.0; of_rows.len() * of_panels.len() * columns],
                panels: of_panels,
                rows: of_rows,
            }
        };
        let parts = self.runs.len() * counts[0] * counts[1];
        let mut parts: Vec<Part> = (0..parts).map(part).collect();
        let pixels = self.pairs.places.len();
        let mut left = vec![W::default(); BLOCKS.min(pixels.div_ceil(2 * PAIRS)) * height * PITCH];
        for pixels in chunks(0..pixels, 2 * PAIRS * BLOCKS) {
            let blocks: Vec<Range<usize>> = chunks(pixels, 2 * PAIRS).collect();
            let turned = left.chunks_mut(height * PITCH).zip(&blocks);
            parallel::each(turned, |(out, pixels)| {
                let turn = Turn {
                    memory: self.pairs.gradient,
                    rows: &self.pairs.places[pixels.clone()],
                    width: self.height,
                    out,
                };
                W::run(self.level, turn);
            });
            on_all_threads(parts.iter_mut().collect(), |part| {
                let add = Add {
                    outer: self,
                    left: &left,
                    blocks: &blocks,
                    part,
                    height,
                };
                W::run(self.level, add);
            });
        }
        Parts {
            all: parts,
            counts,
            rows,
        }
    }
}

/// Joins pixels two by two: panels of `width` numbers, rows of which are pairs, up to a multiple of a tile's depth, with
/// zeros where there are none.
#[inline(always)]
fn join_panels<W: Real>(
    (memory, rows): (&[W], &[usize]),
    (first, width): (usize, usize),
    columns: usize,
    panels: &mut [W],
) {
    let pairs = rows.len().div_ceil(2).next_multiple_of(WORDS);
    for (panel, out) in panels.chunks_exact_mut(pairs * columns).enumerate() {
        let from = first + panel * columns;
        let own = width.saturating_sub(from).min(columns);
        join(&memory[W::words(from)..], rows, (own, columns), out);
    }
}

/// A block of pixels of the left, a row for each of its numbers, [`PITCH`] words apart.
struct Turn<'a, W> {
    memory: &'a [W],
    rows: &'a [usize],
    width: usize,
    out: &'a mut [W],
}

impl<W: Real> WordKernel<W> for Turn<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(self, lanes: S, _: A) {
        let columns = S::F32_LANES;
        let pairs = self.rows.len().div_ceil(2).next_multiple_of(WORDS);
        let mut joined = vec![W::default(); pairs * columns];
        let groups = self.out.chunks_mut(columns * PITCH);
        for (first, out) in (0..self.width).step_by(columns).zip(groups) {
            let from = (self.memory, self.rows);
            join_panels(from, (first, self.width), columns, &mut joined);
            for (step, words) in joined.chunks_exact(WORDS * columns).enumerate() {
                let to: &mut [f32] = bytemuck::cast_slice_mut(&mut out[step * WORDS..]);
                lanes.transpose((lanes_of(words), columns), (to, PITCH));
            }
        }
    }
}

struct Add<'a, 'b, W> {
    outer: &'a OuterTiles<'b, W>,
    left: &'a [W],
    blocks: &'a [Range<usize>],
    part: &'a mut Part,
    height: usize,
}

impl<W: Real> WordKernel<W> for Add<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(mut self, lanes: S, _: A) {
        if !const { compiled::<S, A>() } {
            return;
        }
        match self.outer.kind {
            #[cfg(target_arch = "x86_64")]
            TileKind::Amx(amx) => self.walk(lanes, &mut amx.configured(WORDS)),
            #[cfg(test)]
            TileKind::Software => {
                let mut tiles = super::tests::tiles::Software::new(WORDS, S::F32_LANES);
                self.walk(lanes, &mut tiles);
            }
        }
    }
}

impl<W: Real> Add<'_, '_, W> {
    #[inline(always)]
    fn walk<S: Lanes, T: Tiles<W>>(&mut self, lanes: S, tiles: &mut T) {
        let columns = 2 * S::F32_LANES;
        let Part {
            run,
            panels,
            rows,
            sums,
        } = &mut *self.part;
        let memory = &self.outer.pairs.source[self.outer.runs[*run]..];
        let first = panels.start * columns;
        let mut joined = vec![W::default(); panels.len() * PAIRS * columns];
        let mut tile = Sums([0.0; 2 * HEIGHT * WIDTH]);
        let lefts = self.left.chunks_exact(self.height * PITCH);
        for (pixels, left) in self.blocks.iter().zip(lefts) {
            let starts = &self.outer.pairs.starts[pixels.clone()];
            let pairs = starts.len().div_ceil(2).next_multiple_of(WORDS);
            let joined = &mut joined[..panels.len() * pairs * columns];
            join_panels((memory, starts), (first, self.outer.width), columns, joined);
            for (row, sums) in rows
                .clone()
                .step_by(2 * HEIGHT)
                .zip(sums.chunks_exact_mut(2 * HEIGHT * panels.len() * columns))
            {
                let left = [0, HEIGHT].map(|below| Left {
                    memory: &left[(row + below) * PITCH..],
                    step: PITCH,
                    taps: &[0],
                    lower: None,
                });
                for (panel, right) in joined.chunks_exact(pairs * columns).enumerate() {
                    let right = (right, S::F32_LANES);
                    sum::<W, T, 2, 2>(tiles, [WORDS, pairs], left, right, &mut tile);
                    let rows = sums.chunks_exact_mut(panels.len() * columns);
                    for (sums, tile) in rows.zip(tile.0.chunks_exact(WIDTH)) {
                        let sums = &mut sums[panel * columns..][..columns];
                        let (sums, tile) = (S::as_mut_simd_f32s(sums).0, S::as_simd_f32s(tile).0);
                        for (sum, more) in sums.iter_mut().zip(tile) {
                            *sum = lanes.add_f32s(*sum, *more);
                        }
                    }
                }
            }
        }
    }
}
