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

use super::native::prefetch;
use super::panels::{PANEL_VECTORS, Panel};
use super::product::{CACHE, Epilogue, Finish, Product};
use super::simd::{Lanes, NullaryFnOnce, TileKind};
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

/// Words of a tile's row at least: with fewer, most of a tile would be empty.
const SHALLOWEST: usize = 4;

/// Words of a run at least; rows of shorter runs are copied together first.
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
    /// None where the machine has no tiles, or most of a tile would be empty.
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

/// Whether walks over tiles are compiled for such vectors: where none has tiles beside it, they would take long to
/// compile and never run.
pub(super) const fn compiled<S: Lanes, A: Arithmetic<S>>() -> bool {
    A::BESIDE_TILES || cfg!(test) && S::F32_LANES == 4
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

/// Words of a matrix that stay in the second-level cache beside a map.
const SMALL: usize = 64 << 10;

/// Words of the rows that its panels then meet one after the other.
const NEAR: usize = 8 << 10;

/// The sums of two tiles of rows by a panel.
#[repr(align(64))]
pub(super) struct Sums(pub(super) [f32; 2 * HEIGHT * WIDTH]);

/// Words of a row of them.
pub(super) const WIDTH: usize = PANEL_VECTORS * WORDS;

/// A tile's rows: the first, how many are its own, and the first of those copied together where it is not read where
/// it lies.
#[derive(Clone, Copy)]
struct Rows {
    first: usize,
    count: usize,
    copy: Option<usize>,
}

/// What sums are of.
#[derive(Clone, Copy)]
struct Summed {
    /// The first row, and that after the last.
    rows: (usize, usize),
    frame: usize,
    /// The first column, and how many.
    columns: (usize, usize),
    vectors: usize,
}

impl Summed {
    fn of<W>(pair: &[Rows], frame: usize, panel: &Panel<'_, W>) -> Self {
        let count: usize = pair.iter().map(|rows| rows.count).sum();
        Self {
            rows: (pair[0].first, pair[0].first + count),
            frame,
            columns: (panel.column, panel.columns),
            vectors: panel.vectors,
        }
    }
}

/// Rows of the left that a tile reads.
#[derive(Clone, Copy)]
pub(super) struct Left<'a, W> {
    pub(super) memory: &'a [W],
    /// Words from one row to the next.
    pub(super) step: usize,
    /// Where its runs begin.
    pub(super) taps: &'a [usize],
}

/// Rows that were copied together, and where their runs begin.
struct Copies<W> {
    memory: Vec<W>,
    /// The first row's place in memory, at a cache line.
    first: usize,
    pitch: usize,
    taps: Vec<usize>,
}

impl<W: Word> Copies<W> {
    /// Makes room for so many rows.
    fn begin(&mut self, rows: usize) {
        self.memory.clear();
        self.memory.reserve(rows * self.pitch + WORDS);
        let place = self.memory.as_ptr() as usize / size_of::<W>();
        self.first = place.next_multiple_of(WORDS) - place;
        self.memory.resize(self.first, W::default());
    }
}

impl<W: Word> WordKernel<W> for WriteTiles<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(mut self, lanes: S, arithmetic: A) {
        if !const { compiled::<S, A>() } {
            return;
        }
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
        // Either rows and panels stay in the first-level cache, or rows stay in the second and each panel meets them.
        let words = if k * product.panels.n() <= SMALL {
            NEAR
        } else {
            CACHE
        };
        let block = (words / k).next_multiple_of(2 * HEIGHT);
        let taps = 0..if self.plan.joined {
            1
        } else {
            product.taps.len()
        };
        let mut copies = Copies {
            memory: Vec::new(),
            first: 0,
            // At cache lines, but not all at the same places of the cache.
            pitch: k.next_multiple_of(WORDS) | WORDS,
            taps: taps.map(|tap| tap * product.run).collect(),
        };
        let mut rows = Vec::new();
        let mut sums = Sums([0.0; 2 * HEIGHT * WIDTH]);
        let limits = product.epilogue.needed::<S, A>(k);
        let mut before = None;
        for frame in 0..count.div_ceil(frame_rows) {
            let end = ((frame + 1) * frame_rows).min(count);
            for start in (frame * frame_rows..end).step_by(block) {
                let range = start..(start + block).min(end);
                self.lay_out(range, &mut rows, &mut copies);
                for panel in product.panels.iter() {
                    for pair in rows.chunks(2) {
                        let summed = Summed::of(pair, frame, &panel);
                        // While tiles compute, vectors write what the tiles summed before.
                        let then = before.replace(summed);
                        let write = |this: &mut Self, sums: &Sums, half: usize| {
                            // Of bf16 all at the end: tiles wait for what writes so much.
                            let halves = match (W::WHOLE, half) {
                                (true, _) => half..half + 1,
                                (false, 0) => return,
                                (false, _) => 0..2,
                            };
                            if let Some(summed) = then {
                                this.finish(lanes, arithmetic, (sums, limits), summed, halves);
                            }
                        };
                        let to = (&mut *tiles, &mut sums, S::F32_LANES);
                        self.sum(to, (pair, &copies), summed, panel.data, write);
                    }
                }
            }
        }
        if let Some(summed) = before {
            self.finish(lanes, arithmetic, (&sums, limits), summed, 0..2);
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
        copies.begin(copied);
        for tile in rows.iter().filter(|tile| tile.copy.is_some()) {
            for start in &starts[tile.first..tile.first + tile.count] {
                let before = copies.memory.len();
                for tap in taps {
                    let run = &source[start + tap..][..run];
                    copies.memory.extend_from_slice(run);
                }
                copies.memory.resize(before + copies.pitch, W::default());
            }
            let missing = (HEIGHT - tile.count) * copies.pitch;
            copies
                .memory
                .resize(copies.memory.len() + missing, W::default());
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

    /// Sums one or two tiles of rows by a panel; `write` has one half of the sums before written.
    #[inline(always)]
    fn sum<T: Tiles<W>>(
        &mut self,
        (tiles, sums, lanes): (&mut T, &mut Sums, usize),
        (pair, copies): (&[Rows], &Copies<W>),
        summed: Summed,
        panel: &[W],
        write: impl Fn(&mut Self, &Sums, usize),
    ) {
        let product = self.product;
        if !W::WHOLE && product.epilogue.accumulate.is_some() {
            for place in &self.places[summed.rows.0..summed.rows.1] {
                let place = place - self.origin + W::words(summed.columns.0);
                prefetch(&self.target[place..=place], true);
            }
        }
        let last = pair[pair.len() - 1];
        let left = [left(product, pair[0], copies), left(product, last, copies)];
        let run = product.panels.k() / left[0].taps.len();
        let steps = [self.plan.depth, run];
        let vectors = (panel, lanes);
        let before = &*sums;
        let write = |half| write(self, before, half);
        match (pair.len(), summed.vectors) {
            (1, 1) => multiply::<W, T, 1, 1>(tiles, steps, left, vectors, write),
            (1, _) => multiply::<W, T, 1, 2>(tiles, steps, left, vectors, write),
            (_, 1) => multiply::<W, T, 2, 1>(tiles, steps, left, vectors, write),
            _ => multiply::<W, T, 2, 2>(tiles, steps, left, vectors, write),
        }
        store(tiles, [pair.len(), summed.vectors], lanes, sums);
    }

    /// Writes some of the two tiles of rows that were summed.
    #[inline(always)]
    fn finish<S: Lanes, A: Arithmetic<S, Word = W>>(
        &mut self,
        lanes: S,
        arithmetic: A,
        (sums, limits): (&Sums, usize),
        summed: Summed,
        tiles: Range<usize>,
    ) {
        let (first, end) = summed.rows;
        let rows = [tiles.start, tiles.end].map(|tile| (first + tile * HEIGHT).min(end));
        let finishing = Finishing {
            lanes,
            arithmetic,
            epilogue: self.product.epilogue,
            limits,
            sums: &sums.0[tiles.start * HEIGHT * WIDTH..],
            target: &mut *self.target,
            places: &self.places[rows[0]..rows[1]],
            origin: self.origin,
            frame: summed.frame,
            columns: summed.columns,
        };
        if summed.vectors == 1 {
            arithmetic.apart(lanes, OfVectors::<_, 1>(finishing));
        } else {
            arithmetic.apart(lanes, OfVectors::<_, PANEL_VECTORS>(finishing));
        }
    }
}

/// The rows of a tile.
#[inline(always)]
fn left<'s, W: Word>(
    product: &'s Product<'_, W>,
    rows: Rows,
    copies: &'s Copies<W>,
) -> Left<'s, W> {
    if let Some(copy) = rows.copy {
        return Left {
            memory: &copies.memory[copies.first + copy * copies.pitch..],
            step: copies.pitch,
            taps: &copies.taps,
        };
    }
    let starts = &product.rows[rows.first..];
    Left {
        memory: &product.source[starts[0]..],
        step: starts[1] - starts[0],
        taps: product.taps,
    }
}

/// The sums of `H` tiles of rows, of so many words (a step, then a run), by `V` vectors of a panel's data.
#[inline(always)]
pub(super) fn sum<W: Word, T: Tiles<W>, const H: usize, const V: usize>(
    tiles: &mut T,
    [depth, run]: [usize; 2],
    left: [Left<'_, W>; 2],
    (panel, lanes): (&[W], usize),
    sums: &mut Sums,
) {
    multiply::<W, T, H, V>(tiles, [depth, run], left, (panel, lanes), |_| ());
    store(tiles, [H, V], lanes, sums);
}

/// Leaves the sums in the tiles. Amid the last products, where they take the longest to come, does two halves of
/// something else.
#[inline(always)]
fn multiply<W: Word, T: Tiles<W>, const H: usize, const V: usize>(
    tiles: &mut T,
    [depth, run]: [usize; 2],
    [upper, lower]: [Left<'_, W>; 2],
    (panel, lanes): (&[W], usize),
    mut meanwhile: impl FnMut(usize),
) {
    let width = V * lanes;
    tiles.zero::<0>();
    tiles.zero::<1>();
    tiles.zero::<2>();
    tiles.zero::<3>();
    let taps = upper.taps.iter().zip(lower.taps);
    let mut steps = upper.taps.len() * (run / depth);
    for ((&above, &below), panel) in taps.zip(panel.chunks_exact(run * width)) {
        for (step, right) in panel.chunks_exact(depth * width).enumerate() {
            let at = step * depth;
            steps -= 1;
            tiles.load::<4>(&upper.memory[above + at..], upper.step);
            tiles.load::<6>(right, width);
            tiles.multiply_add::<0, 4, 6>();
            if steps == 0 {
                meanwhile(0);
            }
            if V == 2 {
                tiles.load::<7>(&right[lanes..], width);
                tiles.multiply_add::<1, 4, 7>();
            }
            if H == 2 {
                tiles.load::<5>(&lower.memory[below + at..], lower.step);
                tiles.multiply_add::<2, 5, 6>();
            }
            if steps == 0 {
                meanwhile(1);
            }
            if H == 2 && V == 2 {
                tiles.multiply_add::<3, 5, 7>();
            }
        }
    }
}

/// Writes sums of so many tiles of rows by as many vectors.
#[inline(always)]
fn store<W: Word, T: Tiles<W>>(
    tiles: &mut T,
    [height, vectors]: [usize; 2],
    lanes: usize,
    Sums(sums): &mut Sums,
) {
    let (above, below) = sums.split_at_mut(HEIGHT * WIDTH);
    tiles.store::<0>(above, WIDTH);
    if vectors == 2 {
        tiles.store::<1>(&mut above[lanes..], WIDTH);
    }
    if height == 2 {
        tiles.store::<2>(below, WIDTH);
    }
    if height == 2 && vectors == 2 {
        tiles.store::<3>(&mut below[lanes..], WIDTH);
    }
}

/// Rows of sums to be written by the epilogue of a frame and columns.
struct Finishing<'a, S, A: Arithmetic<S>>
where
    S: Lanes,
{
    lanes: S,
    arithmetic: A,
    epilogue: Epilogue<'a>,
    /// How many of its limits matter.
    limits: usize,
    sums: &'a [f32],
    target: &'a mut [A::Word],
    places: &'a [usize],
    origin: usize,
    frame: usize,
    columns: (usize, usize),
}

/// Of `NV` vectors of columns.
struct OfVectors<F, const NV: usize>(F);

impl<S: Lanes, A: Arithmetic<S>, const NV: usize> NullaryFnOnce
    for OfVectors<Finishing<'_, S, A>, NV>
{
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let whole = self.0.columns.1 == NV * S::F32_LANES;
        let stored = self.0.epilogue.accumulate.is_some();
        // A loop for each, so that none asks in each row.
        match (whole, stored, self.0.limits) {
            (false, ..) => self.0.rows::<NV, false, true, 2>(),
            (_, false, 0) => self.0.rows::<NV, true, false, 0>(),
            (_, false, 1) => self.0.rows::<NV, true, false, 1>(),
            (_, false, _) => self.0.rows::<NV, true, false, 2>(),
            (_, true, 0) => self.0.rows::<NV, true, true, 0>(),
            (_, true, 1) => self.0.rows::<NV, true, true, 1>(),
            (_, true, _) => self.0.rows::<NV, true, true, 2>(),
        }
    }
}

impl<S: Lanes, A: Arithmetic<S>> Finishing<'_, S, A> {
    /// Writes rows that are as long as their vectors, or not; that may be added to what is stored, or are not; so many
    /// of whose limits matter.
    #[inline(always)]
    fn rows<const NV: usize, const WHOLE: bool, const STORED: bool, const LIMITS: usize>(self) {
        let (lanes, arithmetic) = (self.lanes, self.arithmetic);
        let (column, count) = self.columns;
        let columns = (column, if WHOLE { NV * S::F32_LANES } else { count });
        let finish = Finish::<S, NV>::new(lanes, self.epilogue, self.frame, columns);
        let (first, words) = (A::Word::words(column), A::Word::words(columns.1));
        let (sums, _) = S::as_simd_f32s(self.sums);
        for (place, sums) in self
            .places
            .iter()
            .zip(sums.chunks_exact(WIDTH / S::F32_LANES))
        {
            let Some((sums, _)) = sums.split_first_chunk::<NV>() else {
                return;
            };
            let out = &mut self.target[place - self.origin + first..][..words];
            let mut stored = [lanes.splat_f32s(0.0); NV];
            if STORED && finish.accumulate && WHOLE {
                stored = arithmetic.load(lanes, out);
            } else if STORED && finish.accumulate {
                stored = arithmetic.load_part(lanes, out);
            }
            // No closure: one that is not inlined is compiled without the instructions.
            let mut ended = *sums;
            for v in 0..NV {
                let sum = arithmetic.numbers(lanes, ended[v]);
                ended[v] = finish.apply_some::<A, LIMITS>(lanes, arithmetic, v, sum, stored[v]);
            }
            if WHOLE {
                arithmetic.store(lanes, ended, out);
            } else {
                arithmetic.store_part(lanes, ended, out);
            }
        }
    }
}
