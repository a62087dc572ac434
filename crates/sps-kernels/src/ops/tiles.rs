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
//! cache lines, those of a map's border among them, whose sums are dropped; others are copied together first.

use std::ops::Range;

use super::buffer::LINE;
use super::native::prefetch;
use super::panels::{PANEL_VECTORS, Panel};
use super::product::{CACHE, Epilogue, Finish, Product};
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

/// Words of a tile's row at least: with fewer, a tile does too little at once.
const SHALLOWEST: usize = 3;

/// How a product's rows are cut into tiles. It follows from the shape of the weights alone, so that sums have the same
/// bits whatever else is computed with them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plan {
    kind: TileKind,
    /// Words of a tile's row.
    depth: usize,
}

impl Plan {
    /// None where the machine has no tiles, or a tile would do too little at once.
    pub(super) fn of<W: Word>(product: &Product<'_, W>) -> Option<Self> {
        let kind = product.panels.level.tiles().filter(|_| W::NUMBERS > 1)?;
        Some(Self {
            kind,
            depth: deepest(product.run)?,
        })
    }
}

/// The most words of a tile's row that divide a run of so many; none where that is fewer than [`SHALLOWEST`].
pub(super) fn deepest(run: usize) -> Option<usize> {
    let divides = |depth: &usize| run.is_multiple_of(*depth);
    (SHALLOWEST..=WORDS).rev().find(divides)
}

/// Whether walks over tiles are compiled for such vectors: where none has tiles beside it, they would take long to
/// compile and never run.
pub(super) const fn compiled<S: Lanes, A: Arithmetic<S>>() -> bool {
    A::BESIDE_TILES || cfg!(test) && S::F32_LANES == 4
}

/// Writes a product of words `L` into a map of words `W`, as [`Product::write`] says.
pub(super) struct WriteTiles<'a, 'b, L, W> {
    pub(super) plan: Plan,
    pub(super) product: &'a Product<'b, L>,
    pub(super) target: &'a mut [W],
    pub(super) places: &'a [usize],
    pub(super) origin: usize,
}

/// Words of a matrix that stay in the second-level cache beside a map.
const SMALL: usize = 64 << 10;

/// Words of the rows, and of what is written of them, that its panels then meet one after the other.
const NEAR: usize = 8 << 10;

/// The sums of two tiles of rows by a panel.
#[repr(align(64))]
pub(super) struct Sums(pub(super) [f32; 2 * HEIGHT * WIDTH]);

/// Words of a row of them.
pub(super) const WIDTH: usize = PANEL_VECTORS * WORDS;

/// Rows of a tile at least that are wanted, where it is read where it lies: with fewer, copying is faster.
const FULL: usize = 12;

/// A tile's rows.
#[derive(Clone, Copy)]
struct Rows {
    first: usize,
    count: usize,
    read: Read,
}

/// Where a tile's rows are read.
#[derive(Clone, Copy)]
enum Read {
    /// Where they lie, so many words from one to the next.
    Source(usize),
    /// Copied together, after so many tiles of the frame.
    Copy(usize),
}

/// What sums are of.
#[derive(Clone, Copy)]
struct Summed {
    /// The first row, and how many.
    rows: (usize, usize),
    frame: usize,
    /// The first column, and how many.
    columns: (usize, usize),
    vectors: usize,
}

impl Summed {
    fn of<W>(pair: &[Rows], frame: usize, panel: &Panel<'_, W>) -> Self {
        let count = pair.iter().map(|rows| rows.count).sum();
        Self {
            rows: (pair[0].first, count),
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
    /// How far behind each a run of lower halves does.
    pub(super) lower: Option<usize>,
}

/// Tiles whose rows were copied together, and where their runs begin.
struct Copies<W> {
    memory: Vec<W>,
    /// The first tile's place in memory, at a cache line, and how many were copied before it.
    first: usize,
    before: usize,
    pitch: usize,
    taps: Vec<usize>,
    lower: Option<usize>,
}

impl<W: Word> Copies<W> {
    /// Copies those of some tiles that are not read where they lie.
    #[inline(always)]
    fn fill(&mut self, tiles: &[Rows], product: &Product<'_, W>) {
        let place = |tile: &Rows| match tile.read {
            Read::Source(_) => None,
            Read::Copy(before) => Some(before),
        };
        let Some(first) = tiles.iter().find_map(place) else {
            return;
        };
        let last = tiles.iter().rev().find_map(place).unwrap_or(first);
        self.before = first;
        let words = (last + 1 - first) * HEIGHT * self.pitch + 2 * WORDS;
        if words > self.memory.len() {
            self.memory = vec![W::default(); words];
        }
        let base = self.memory.as_ptr() as usize / size_of::<W>();
        self.first = base.next_multiple_of(WORDS) - base;
        let Product {
            source, rows, run, ..
        } = *product;
        let halves = [0, product.lower.unwrap_or(0)];
        let halves = &halves[..=usize::from(product.lower.is_some())];
        let runs = halves
            .iter()
            .flat_map(|half| product.taps.iter().map(move |tap| half + tap));
        for (n, from) in runs.enumerate() {
            let (from, to) = (&source[from..], &mut self.memory[self.first + n * run..]);
            for (tile, before) in tiles.iter().filter_map(|tile| Some((tile, place(tile)?))) {
                let mut at = (before - first) * HEIGHT * self.pitch;
                for start in &rows[tile.first..tile.first + tile.count] {
                    copy(&from[*start..], &mut to[at..], run);
                    at += self.pitch;
                }
            }
        }
    }

    /// The rows of a tile, from these copies or from the source.
    #[inline(always)]
    fn left<'s>(&'s self, product: &'s Product<'_, W>, rows: Rows) -> Left<'s, W> {
        match rows.read {
            Read::Copy(before) => Left {
                memory: &self.memory[self.first + (before - self.before) * HEIGHT * self.pitch..],
                step: self.pitch,
                taps: &self.taps,
                lower: self.lower,
            },
            Read::Source(step) => Left {
                memory: &product.source[product.rows[rows.first]..],
                step,
                taps: product.taps,
                lower: product.lower,
            },
        }
    }
}

/// Copies so many words, and what would fill the last vector where there is as much on both sides.
#[inline(always)]
fn copy<W: Copy>(from: &[W], to: &mut [W], words: usize) {
    if let (Some(vector), Some(place)) = (from.first_chunk(), to.first_chunk_mut::<WORDS>())
        && words <= WORDS
    {
        *place = *vector;
        return;
    }
    let whole = words.next_multiple_of(WORDS);
    let words = if whole <= from.len().min(to.len()) {
        whole
    } else {
        words
    };
    to[..words].copy_from_slice(&from[..words]);
}

impl<L: Word, W: Word> WordKernel<W> for WriteTiles<'_, '_, L, W> {
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

impl<L: Word, W: Word> WriteTiles<'_, '_, L, W> {
    #[inline(always)]
    fn walk<S, A, T>(&mut self, lanes: S, arithmetic: A, tiles: &mut T)
    where
        S: Lanes,
        A: Arithmetic<S, Word = W>,
        T: Tiles<L>,
    {
        let product = self.product;
        let k = product.panels.k;
        let count = self.places.len();
        let frame_rows = if product.epilogue.per_frame() {
            product.frame_rows.max(1)
        } else {
            count.max(1)
        };
        // Either panels, rows and what is written stay in the first-level cache, or rows stay in the second and each
        // panel, brought near while the one before it is multiplied, meets them.
        let n = product.panels.n;
        let streamed = k * n > SMALL;
        let block = |words: usize| {
            let rows = if streamed {
                CACHE / words
            } else {
                NEAR / (words + W::words(n))
            };
            rows.div_ceil(2 * HEIGHT) * 2
        };
        let mut copies = Copies {
            memory: Vec::new(),
            first: 0,
            before: 0,
            // At cache lines, but not all at the same places of the cache; a run's last vector is whole.
            pitch: (k - product.run + product.run.next_multiple_of(WORDS)).next_multiple_of(WORDS)
                | WORDS,
            taps: (0..product.taps.len())
                .map(|tap| tap * product.run)
                .collect(),
            lower: product.lower.map(|_| product.taps.len() * product.run),
        };
        let mut sums = Sums([0.0; 2 * HEIGHT * WIDTH]);
        let limits = product.epilogue.needed::<S, A>(k);
        let mut within = vec![0; count];
        let mut before = None;
        for frame in 0..count.div_ceil(frame_rows) {
            let rows = frame * frame_rows..((frame + 1) * frame_rows).min(count);
            let cut = self.cut(rows, &mut within);
            // Rows that are copied share no words.
            let copied = |rows: &&Rows| matches!(rows.read, Read::Copy(_));
            let most = 2 * cut.iter().filter(copied).count() > cut.len();
            let words = if most { k } else { product.row_words() };
            for block in cut.chunks(block(words)) {
                copies.fill(block, product);
                let pairs = block.chunks(2);
                let mut panels = product.panels.iter().peekable();
                while let Some(panel) = panels.next() {
                    let next = panels.peek().filter(|_| streamed);
                    let next: &[L] = next.map_or(&[], |next| next.data);
                    let mut next = next.chunks(next.len().div_ceil(pairs.len()).max(1));
                    for pair in pairs.clone() {
                        let summed = Summed::of(pair, frame, &panel);
                        let next = next.next().unwrap_or_default();
                        let panel = (panel.data, next, S::F32_LANES);
                        self.multiply(tiles, (pair, &copies), summed, panel);
                        // While tiles compute, vectors write what was summed before.
                        if let Some(before) = before.replace(summed) {
                            let of = (&sums, &within[..], limits);
                            self.finish(lanes, arithmetic, of, before);
                        }
                        let shape = [pair.len(), summed.vectors];
                        store(tiles, shape, S::F32_LANES, &mut sums);
                    }
                }
            }
        }
        if let Some(before) = before {
            self.finish(lanes, arithmetic, (&sums, &within, limits), before);
        }
    }

    /// Cuts a frame's rows into tiles; `within` is told each row's place in its pair of tiles.
    fn cut(&self, rows: Range<usize>, within: &mut [u8]) -> Vec<Rows> {
        let taps = self.product.taps;
        // Words that a row needs.
        let lower = self.product.lower.unwrap_or(0);
        let reach = taps.iter().max().map(|tap| tap + lower + self.product.run);
        let mut tiles = Vec::with_capacity(rows.len() / FULL + 1);
        let (mut first, mut copied) = (rows.start, 0);
        while first < rows.end {
            let within = &mut within[first..rows.end];
            let lying = reach.and_then(|reach| self.lying(first, reach, within));
            let tile = lying.unwrap_or_else(|| {
                copied += 1;
                let count = HEIGHT.min(within.len());
                for (row, place) in within[..count].iter_mut().enumerate() {
                    *place = row as u8;
                }
                Rows {
                    first,
                    count,
                    read: Read::Copy(copied - 1),
                }
            });
            if tiles.len() % 2 == 1 {
                for place in &mut within[..tile.count] {
                    *place += HEIGHT as u8;
                }
            }
            first += tile.count;
            tiles.push(tile);
        }
        tiles
    }

    /// The rows from one on as a tile that is read where it lies; none where that is impossible or slow.
    fn lying(&self, first: usize, reach: usize, within: &mut [u8]) -> Option<Rows> {
        let source = self.product.source;
        let starts = &self.product.rows[first..first + within.len()];
        let start = starts[0];
        let step = match starts {
            [_, next, ..] => next.checked_sub(start)?,
            _ => 0,
        };
        if start + (HEIGHT - 1) * step + reach > source.len() {
            return None;
        }
        let (mut place, mut at, mut count) = (0, start, 0);
        for (&row, to) in starts.iter().zip(within) {
            while at < row && place + 1 < HEIGHT {
                at += step;
                place += 1;
            }
            if at != row {
                break;
            }
            *to = place as u8;
            count += 1;
        }
        let enough = count >= FULL.min(starts.len());
        enough.then_some(Rows {
            first,
            count,
            read: Read::Source(step),
        })
    }

    /// Sums one or two tiles of rows by a panel. The sums stay in the tiles.
    #[inline(always)]
    fn multiply<T: Tiles<L>>(
        &self,
        tiles: &mut T,
        (pair, copies): (&[Rows], &Copies<L>),
        summed: Summed,
        panel: (&[L], &[L], usize),
    ) {
        let product = self.product;
        if !W::WHOLE && product.epilogue.accumulate.is_some() {
            for place in self.places.iter().skip(summed.rows.0).take(summed.rows.1) {
                let place = place - self.origin + W::words(summed.columns.0);
                prefetch(&self.target[place..=place], true);
            }
        }
        let last = pair[pair.len() - 1];
        let left = [copies.left(product, pair[0]), copies.left(product, last)];
        let steps = [self.plan.depth, product.run];
        match (pair.len(), summed.vectors) {
            (1, 1) => multiply::<L, T, 1, 1>(tiles, steps, left, panel),
            (1, _) => multiply::<L, T, 1, 2>(tiles, steps, left, panel),
            (_, 1) => multiply::<L, T, 2, 1>(tiles, steps, left, panel),
            _ => multiply::<L, T, 2, 2>(tiles, steps, left, panel),
        }
    }

    /// Writes the rows that were summed.
    #[inline(always)]
    fn finish<S: Lanes, A: Arithmetic<S, Word = W>>(
        &mut self,
        lanes: S,
        arithmetic: A,
        (sums, within, limits): (&Sums, &[u8], usize),
        summed: Summed,
    ) {
        let (first, count) = summed.rows;
        let rows = first..first + count;
        let finishing = Finishing {
            lanes,
            arithmetic,
            epilogue: self.product.epilogue,
            limits,
            sums,
            within: &within[rows.clone()],
            target: &mut *self.target,
            places: &self.places[rows],
            origin: self.origin,
            frame: summed.frame,
            columns: summed.columns,
        };
        if summed.vectors == 1 {
            finishing.write::<1>();
        } else {
            finishing.write::<PANEL_VECTORS>();
        }
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
    multiply::<W, T, H, V>(tiles, [depth, run], left, (panel, &[], lanes));
    store(tiles, [H, V], lanes, sums);
}

/// Leaves the sums in the tiles. Meanwhile brings what is read next near.
#[inline(always)]
fn multiply<W: Word, T: Tiles<W>, const H: usize, const V: usize>(
    tiles: &mut T,
    [depth, run]: [usize; 2],
    [upper, lower]: [Left<'_, W>; 2],
    (panel, next, lanes): (&[W], &[W], usize),
) {
    let width = V * lanes;
    tiles.zero::<0>();
    tiles.zero::<1>();
    tiles.zero::<2>();
    tiles.zero::<3>();
    let taps = upper.taps.iter().zip(lower.taps);
    let steps = upper.taps.len() * (run / depth);
    let lines = next.len().div_ceil(LINE).div_ceil(steps.max(1)).max(1);
    let mut next = next.chunks(LINE * lines);
    let words = run * width;
    let halves = 1 + usize::from(upper.lower.is_some());
    for ((&above, &below), panel) in taps.zip(panel.chunks_exact(halves * words)) {
        for step in 0..run / depth {
            let at = step * depth;
            let right = |run: usize| (&panel[run * words + at * width..][..depth * width], width);
            let left = [&upper.memory[above + at..], &lower.memory[below + at..]];
            let rows = [upper.step, lower.step];
            prefetch(next.next().unwrap_or_default(), false);
            load_right::<W, T, V>(tiles, right(0), lanes);
            if let (Some(above), Some(below)) = (upper.lower, lower.lower) {
                // Lower halves by upper ones, upper by upper, upper by lower: each is loaded once.
                load_left::<W, T, H>(tiles, [&left[0][above..], &left[1][below..]], rows);
                add::<W, T, H, V>(tiles);
                load_left::<W, T, H>(tiles, left, rows);
                add::<W, T, H, V>(tiles);
                load_right::<W, T, V>(tiles, right(1), lanes);
            } else {
                load_left::<W, T, H>(tiles, left, rows);
            }
            add::<W, T, H, V>(tiles);
        }
    }
}

/// Loads `H` tiles of the left.
#[inline(always)]
fn load_left<W: Word, T: Tiles<W>, const H: usize>(
    tiles: &mut T,
    left: [&[W]; 2],
    rows: [usize; 2],
) {
    tiles.load::<4>(left[0], rows[0]);
    if H == 2 {
        tiles.load::<5>(left[1], rows[1]);
    }
}

/// Loads `V` tiles of the right.
#[inline(always)]
fn load_right<W: Word, T: Tiles<W>, const V: usize>(
    tiles: &mut T,
    (right, width): (&[W], usize),
    lanes: usize,
) {
    tiles.load::<6>(right, width);
    if V == 2 {
        tiles.load::<7>(&right[lanes..], width);
    }
}

/// Adds the products of the tiles that are loaded. All are loaded before the first product: where a core's other thread
/// computes too, that is a tenth faster than one by one.
#[inline(always)]
fn add<W: Word, T: Tiles<W>, const H: usize, const V: usize>(tiles: &mut T) {
    tiles.multiply_add::<0, 4, 6>();
    if V == 2 {
        tiles.multiply_add::<1, 4, 7>();
    }
    if H == 2 {
        tiles.multiply_add::<2, 5, 6>();
    }
    if H == 2 && V == 2 {
        tiles.multiply_add::<3, 5, 7>();
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
struct Finishing<'a, S: Lanes, A: Arithmetic<S>> {
    lanes: S,
    arithmetic: A,
    epilogue: Epilogue<'a>,
    /// How many of its limits matter.
    limits: usize,
    sums: &'a Sums,
    /// Each row's place in them.
    within: &'a [u8],
    target: &'a mut [A::Word],
    places: &'a [usize],
    origin: usize,
    frame: usize,
    columns: (usize, usize),
}

impl<S: Lanes, A: Arithmetic<S>> Finishing<'_, S, A> {
    /// Writes rows of `NV` vectors of columns.
    #[inline(always)]
    fn write<const NV: usize>(mut self) {
        let whole = self.columns.1 == NV * S::F32_LANES;
        let stored = self.epilogue.accumulate.is_some();
        self.arithmetic.apart(
            self.lanes,
            // A loop for each, so that none asks in each row.
            #[inline(always)]
            move || match (whole, stored, self.limits) {
                (false, ..) => self.rows::<NV, false, true, 2>(),
                (_, false, 0) => self.rows::<NV, true, false, 0>(),
                (_, false, 1) => self.rows::<NV, true, false, 1>(),
                (_, false, _) => self.rows::<NV, true, false, 2>(),
                (_, true, 0) => self.rows::<NV, true, true, 0>(),
                (_, true, 1) => self.rows::<NV, true, true, 1>(),
                (_, true, _) => self.rows::<NV, true, true, 2>(),
            },
        );
    }

    /// Writes rows that are as long as their vectors, or not; that may be added to what is stored, or are not; so many
    /// of whose limits matter.
    #[inline(always)]
    fn rows<const NV: usize, const WHOLE: bool, const STORED: bool, const LIMITS: usize>(
        &mut self,
    ) {
        let (column, count) = self.columns;
        let columns = (column, if WHOLE { NV * S::F32_LANES } else { count });
        let mut finish = Finish::<S, NV>::new(self.lanes, self.epilogue, self.frame, columns);
        // As a constant where nothing is stored, so that no row asks.
        finish.accumulate &= STORED;
        let (first, words) = (A::Word::words(column), A::Word::words(columns.1));
        let (sums, _) = S::as_simd_f32s(&self.sums.0);
        for (place, &within) in self.places.iter().zip(self.within) {
            let sums = &sums[usize::from(within) * (WIDTH / S::F32_LANES)..];
            let Some((sums, _)) = sums.split_first_chunk::<NV>() else {
                return;
            };
            let out = &mut self.target[place - self.origin + first..][..words];
            finish.store::<A, WHOLE, LIMITS>(self.lanes, self.arithmetic, *sums, out);
        }
    }
}
