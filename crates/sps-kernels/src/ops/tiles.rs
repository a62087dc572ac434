//! Products by matrix tiles: 16 rows of the left by a vector of columns at once.
//!
//! ```text
//!            panel: two vectors of columns
//!            +--------+--------+
//!            | right  | right  |  depth words
//!  +-------+ +--------+--------+
//!  | left  | |  sum   |  sum   |  16 rows
//!  +-------+ +--------+--------+
//!  | left  | |  sum   |  sum   |  16 rows
//!  +-------+ +--------+--------+
//!    depth words
//! ```
//!
//! A right tile is a piece of a panel as it lies. A left tile is 16 rows of the source where they lie evenly and at
//! cache lines; others are copied together first.

use std::ops::Range;

use super::buffer::Buffer;
use super::panels::{PANEL_VECTORS, Panel};
use super::product::{Finish, Product};
use super::simd::{Lanes, TileKind};
use super::words::{Arithmetic, Word, WordKernel};

/// Rows of a tile of the left and of sums.
pub(super) const HEIGHT: usize = 16;

/// Words of a row.
pub(super) const WORDS: usize = 16;

/// Eight matrices in registers: of sums 0 to 3, of the left 4 and 5, of the right 6 and 7.
pub(super) trait Tiles<W: Word> {
    /// Clears a tile of sums.
    fn zero<const TILE: usize>(&mut self);

    /// Reads a tile of the left or the right, whose rows lie `step` words apart.
    fn load<const TILE: usize>(&mut self, from: &[W], step: usize);

    /// Adds the product of two tiles to one of sums.
    fn multiply_add<const SUM: usize, const LEFT: usize, const RIGHT: usize>(&mut self);

    /// Writes a tile of sums, bits of what [`Arithmetic::multiply_add`] sums in, rows `step` words apart.
    fn store<const TILE: usize>(&mut self, to: &mut [f32], step: usize);
}

/// Words of a tile's row at least, or vectors are faster.
const SHALLOWEST: usize = 4;

/// As many where rows are read where they lie.
const DEEP: usize = 8;

/// How a product's rows are cut into tiles. It follows from the shape of the weights and the layout of the map alone, so
/// that sums have the same bits whatever else is computed with them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plan {
    kind: TileKind,
    /// Words of a tile's row.
    depth: usize,
    /// Whether all rows are copied together, as their runs are too short for tiles.
    joined: bool,
}

impl Plan {
    /// None where the machine has no tiles, or vectors are faster.
    pub(super) fn of<W: Word>(product: &Product<'_, W>) -> Option<Self> {
        let kind = product.panels.level().tiles().filter(|_| W::NUMBERS > 1)?;
        let by_run = deepest(product.run);
        let joined = by_run < DEEP;
        let depth = if joined {
            deepest(product.panels.k())
        } else {
            by_run
        };
        (depth >= SHALLOWEST).then_some(Self {
            kind,
            depth,
            joined,
        })
    }
}

/// The largest depth that a run is a multiple of.
fn deepest(run: usize) -> usize {
    let depths = (1..=WORDS).rev();
    depths
        .into_iter()
        .find(|depth| run.is_multiple_of(*depth))
        .unwrap_or(1)
}

/// Writes a product, as [`Product::write`] says.
pub(super) struct WriteTiles<'a, 'b, W> {
    pub(super) plan: Plan,
    pub(super) product: &'a Product<'b, W>,
    pub(super) target: &'a mut [W],
    pub(super) places: &'a [usize],
    pub(super) origin: usize,
}

/// Words of the rows that meet one panel after the other.
const BLOCK: usize = 32 << 10;

/// The sums of two tiles of rows by a panel.
#[repr(align(64))]
struct Sums([f32; 2 * HEIGHT * WIDTH]);

/// Words of a row of them.
const WIDTH: usize = PANEL_VECTORS * WORDS;

/// A tile's rows: the first, how many are its own, and the first of those copied together where it is not read where
/// it lies.
#[derive(Clone, Copy)]
struct Rows {
    first: usize,
    count: usize,
    copy: Option<usize>,
}

/// Rows of the left that a tile reads.
#[derive(Clone, Copy)]
struct Left<'a, W> {
    memory: &'a [W],
    /// Words from one row to the next.
    step: usize,
    /// Where its runs begin.
    taps: &'a [usize],
}

/// Rows that were copied together, and where their runs begin.
struct Copies<W> {
    memory: Buffer<W>,
    pitch: usize,
    taps: Vec<usize>,
}

impl<W: Word> WordKernel<W> for WriteTiles<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(mut self, lanes: S, arithmetic: A) {
        match self.plan.kind {
            #[cfg(target_arch = "x86_64")]
            TileKind::Amx(amx) => {
                self.walk(lanes, arithmetic, &mut amx.configured(self.plan.depth));
            }
            #[cfg(test)]
            TileKind::Software => {
                let mut tiles = super::tests::tiles::Software::new(self.plan.depth, S::F32_LANES);
                self.walk(lanes, arithmetic, &mut tiles);
            }
        }
    }
}

impl<W: Word> WriteTiles<'_, '_, W> {
    #[inline(always)]
    fn walk<S, A, T>(&mut self, lanes: S, arithmetic: A, tiles: &mut T)
    where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
        T: Tiles<W>,
    {
        let product = self.product;
        let k = product.panels.k();
        let count = self.places.len();
        let frame_rows = if product.epilogue.per_frame() {
            product.frame_rows.max(1)
        } else {
            count.max(1)
        };
        let block = (BLOCK / k).next_multiple_of(2 * HEIGHT);
        let taps = 0..if self.plan.joined {
            1
        } else {
            product.taps.len()
        };
        let mut copies = Copies {
            memory: Buffer::default(),
            // At cache lines, but not all at the same places of the cache.
            pitch: k.next_multiple_of(WORDS) | WORDS,
            taps: taps.map(|tap| tap * product.run).collect(),
        };
        let mut rows = Vec::new();
        for frame in 0..count.div_ceil(frame_rows) {
            let end = ((frame + 1) * frame_rows).min(count);
            for start in (frame * frame_rows..end).step_by(block) {
                let range = start..(start + block).min(end);
                self.lay_out(range, &mut rows, &mut copies);
                for panel in product.panels.iter() {
                    for pair in rows.chunks(2) {
                        let panel = (frame, panel);
                        self.write(lanes, arithmetic, tiles, (pair, &copies), panel);
                    }
                }
            }
        }
    }

    /// Cuts rows into tiles, and copies together those that are not read where they lie.
    fn lay_out(&self, range: Range<usize>, rows: &mut Vec<Rows>, copies: &mut Copies<W>) {
        let Product {
            source,
            rows: starts,
            taps,
            run,
            ..
        } = *self.product;
        rows.clear();
        let mut copied = 0;
        for first in range.clone().step_by(HEIGHT) {
            let count = HEIGHT.min(range.end - first);
            let copy = (!self.in_place(&starts[first..first + count])).then_some(copied);
            copied += if copy.is_some() { HEIGHT } else { 0 };
            rows.push(Rows { first, count, copy });
        }
        copies.memory.resize(copied * copies.pitch);
        for tile in rows.iter() {
            let Some(copy) = tile.copy else { continue };
            let starts = &starts[tile.first..tile.first + tile.count];
            let copies = copies.memory[copy * copies.pitch..].chunks_exact_mut(copies.pitch);
            for (start, copy) in starts.iter().zip(copies) {
                for (tap, copy) in taps.iter().zip(copy.chunks_exact_mut(run)) {
                    copy.copy_from_slice(&source[start + tap..][..run]);
                }
            }
        }
    }

    /// Whether a tile can be read where it lies.
    fn in_place(&self, starts: &[usize]) -> bool {
        if self.plan.joined || starts.len() < HEIGHT {
            return false;
        }
        let step = starts[1].wrapping_sub(starts[0]);
        // A row of a tile that reaches over a cache line takes twice as long.
        let line = self.plan.depth.next_power_of_two() - 1;
        let base = self.product.source.as_ptr() as usize / size_of::<W>();
        let even = |pair: &[usize]| pair[1].wrapping_sub(pair[0]) == step;
        ((base + starts[0]) | step) & line == 0
            && self.product.taps.iter().all(|tap| tap & line == 0)
            && starts.windows(2).all(even)
    }

    /// The rows of a tile.
    #[inline(always)]
    fn left<'s>(&'s self, rows: Rows, copies: &'s Copies<W>) -> Left<'s, W> {
        if let Some(copy) = rows.copy {
            return Left {
                memory: &copies.memory[copy * copies.pitch..],
                step: copies.pitch,
                taps: &copies.taps,
            };
        }
        let starts = &self.product.rows[rows.first..];
        Left {
            memory: &self.product.source[starts[0]..],
            step: starts[1] - starts[0],
            taps: self.product.taps,
        }
    }

    /// One or two tiles of rows by a panel.
    #[inline(always)]
    fn write<S, A, T>(
        &mut self,
        lanes: S,
        arithmetic: A,
        tiles: &mut T,
        (pair, copies): (&[Rows], &Copies<W>),
        (frame, panel): (usize, Panel<'_, W>),
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
        T: Tiles<W>,
    {
        let mut sums = Sums([0.0; 2 * HEIGHT * WIDTH]);
        let left = [pair[0], pair[pair.len() - 1]].map(|rows| self.left(rows, copies));
        let vectors = (panel.data, S::F32_LANES);
        match (pair.len(), panel.vectors) {
            (1, 1) => self.sum::<T, 1, 1>(tiles, left, vectors, &mut sums),
            (1, _) => self.sum::<T, 1, 2>(tiles, left, vectors, &mut sums),
            (_, 1) => self.sum::<T, 2, 1>(tiles, left, vectors, &mut sums),
            _ => self.sum::<T, 2, 2>(tiles, left, vectors, &mut sums),
        }
        let count: usize = pair.iter().map(|rows| rows.count).sum();
        let rows = pair[0].first..pair[0].first + count;
        let columns = (panel.column, panel.columns);
        if panel.vectors == 1 {
            self.finish::<S, A, 1>(lanes, arithmetic, &sums, rows, (frame, columns));
        } else {
            self.finish::<S, A, 2>(lanes, arithmetic, &sums, rows, (frame, columns));
        }
    }

    /// The sums of `H` tiles of rows by `V` vectors of a panel's data.
    #[inline(always)]
    fn sum<T: Tiles<W>, const H: usize, const V: usize>(
        &self,
        tiles: &mut T,
        [upper, lower]: [Left<'_, W>; 2],
        (panel, lanes): (&[W], usize),
        Sums(sums): &mut Sums,
    ) {
        let width = V * lanes;
        let depth = self.plan.depth;
        let run = self.product.panels.k() / upper.taps.len();
        tiles.zero::<0>();
        tiles.zero::<1>();
        tiles.zero::<2>();
        tiles.zero::<3>();
        let taps = upper.taps.iter().zip(lower.taps);
        for ((&above, &below), panel) in taps.zip(panel.chunks_exact(run * width)) {
            for (step, right) in panel.chunks_exact(depth * width).enumerate() {
                let at = step * depth;
                tiles.load::<4>(&upper.memory[above + at..], upper.step);
                tiles.load::<6>(right, width);
                tiles.multiply_add::<0, 4, 6>();
                if V == 2 {
                    tiles.load::<7>(&right[lanes..], width);
                    tiles.multiply_add::<1, 4, 7>();
                }
                if H == 2 {
                    tiles.load::<5>(&lower.memory[below + at..], lower.step);
                    tiles.multiply_add::<2, 5, 6>();
                }
                if H == 2 && V == 2 {
                    tiles.multiply_add::<3, 5, 7>();
                }
            }
        }
        tiles.store::<0>(sums, WIDTH);
        if V == 2 {
            tiles.store::<1>(&mut sums[lanes..], WIDTH);
        }
        let below = &mut sums[HEIGHT * WIDTH..];
        if H == 2 {
            tiles.store::<2>(below, WIDTH);
        }
        if H == 2 && V == 2 {
            tiles.store::<3>(&mut below[lanes..], WIDTH);
        }
    }

    /// Writes rows of sums by the epilogue of a frame and columns.
    #[inline(always)]
    fn finish<S, A, const NV: usize>(
        &mut self,
        lanes: S,
        arithmetic: A,
        Sums(sums): &Sums,
        rows: Range<usize>,
        (frame, columns): (usize, (usize, usize)),
    ) where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
    {
        let (column, count) = columns;
        let whole = count == NV * S::F32_LANES;
        let epilogue = self.product.epilogue;
        let finish = Finish::<S, NV>::new(lanes, epilogue, frame, columns);
        let first = W::words(column);
        for (place, sums) in self.places[rows].iter().zip(sums.chunks_exact(WIDTH)) {
            let sums = S::as_simd_f32s(sums).0;
            let mut ended = [lanes.splat_f32s(0.0); NV];
            ended.copy_from_slice(&sums[..NV]);
            let out = &mut self.target[place - self.origin + first..][..W::words(count)];
            let mut stored = [lanes.splat_f32s(0.0); NV];
            if finish.accumulate && whole {
                stored = arithmetic.load(lanes, out);
            } else if finish.accumulate {
                stored = arithmetic.load_part(lanes, out);
            }
            let ended = finish.apply(lanes, arithmetic, &ended, stored);
            if whole {
                arithmetic.store(lanes, ended, out);
            } else {
                arithmetic.store_part(lanes, ended, out);
            }
        }
    }
}
