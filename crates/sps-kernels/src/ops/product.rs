//! Convolution as a product of gathered rows and a packed matrix.
//!
//! A row of the left operand is never copied together: it is a list of runs of the source, one
//! for each tap of the window, all at the same distances from the row's first element. With a
//! source that has its zero padding around it this is every convolution there is; a 1x1
//! convolution has one tap.

use super::bands::on_all_threads;
use super::buffer::Buffer;
use super::grid::starts;
use super::native::prefetch;
use super::panels::{PANEL_VECTORS, Panel, PanelRun, Panels};
use super::simd::{Lanes, load};
use super::tiles::{Plan, WriteTiles};
use super::unroll::{tallest, tiles};
use super::words::{Arithmetic, Word, WordKernel, lanes_of};

/// What happens to a sum before it is stored: `sum * scale + shift + factor * stored` within limits,
/// each part where it is wanted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Epilogue<'a> {
    pub(crate) scale: Option<Columns<'a>>,
    pub(crate) shift: Option<Columns<'a>>,
    /// The factor of what is stored already, where that is added.
    pub(crate) accumulate: Option<f32>,
    /// What nothing that is stored lies below, and what nothing lies above.
    pub(crate) limits: [f32; 2],
}

impl Default for Epilogue<'_> {
    fn default() -> Self {
        Self {
            scale: None,
            shift: None,
            accumulate: None,
            limits: Activation::Identity.limits(),
        }
    }
}

/// What becomes of the numbers that leave a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Activation {
    /// They stay as they are.
    #[default]
    Identity,
    /// Negative ones become 0.
    Relu,
    /// Negative ones become 0, those above 6 become 6.
    Relu6,
}

impl Activation {
    /// What no number lies below, and what none lies above.
    #[inline(always)]
    pub const fn limits(self) -> [f32; 2] {
        match self {
            Self::Identity => [f32::NEG_INFINITY, f32::INFINITY],
            Self::Relu => [0.0, f32::INFINITY],
            Self::Relu6 => [0.0, 6.0],
        }
    }
}

/// A number for each column, the same in every frame or each frame's own.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Columns<'a> {
    pub(super) values: &'a [f32],
    /// From one frame's numbers to the next's.
    stride: usize,
}

impl<'a> Columns<'a> {
    /// `(n)`, the same in every frame.
    pub(crate) const fn shared(values: &'a [f32]) -> Self {
        Self { values, stride: 0 }
    }

    /// `(frames, n)`.
    pub(crate) const fn per_frame(values: &'a [f32], n: usize) -> Self {
        Self { values, stride: n }
    }

    /// Those from a frame and a column on.
    #[inline(always)]
    pub(crate) fn from(self, frame: usize, column: usize) -> Self {
        Self {
            values: &self.values[frame * self.stride + column..],
            ..self
        }
    }
}

impl<'a> Epilogue<'a> {
    /// Adds a number to each column and activates.
    pub(crate) fn biased(bias: &'a [f32], activation: Activation) -> Self {
        Self {
            shift: Some(Columns::shared(bias)),
            limits: activation.limits(),
            ..Self::default()
        }
    }

    /// Whether each frame has its own.
    pub(super) fn per_frame(&self) -> bool {
        let own = |columns: Option<Columns<'_>>| columns.is_some_and(|columns| columns.stride > 0);
        own(self.scale) || own(self.shift)
    }

    /// How many of the limits matter to sums of so many words, the lower one first.
    pub(super) fn needed<S: Lanes, A: Arithmetic<S>>(&self, k: usize) -> usize {
        let [least, most] = self.limits;
        if !A::CUTS {
            let lower = usize::from(least > f32::NEG_INFINITY);
            return if most < f32::INFINITY { 2 } else { lower };
        }
        // What is cut has to fit an integer before: each part a quarter of it.
        let longest = (k * A::Word::NUMBERS * 255 * 127) as f32;
        let part = (1 << 29) as f32;
        let within = |columns: Option<Columns<'_>>, factor: f32| {
            let values = columns.map_or(&[1.0][..], |columns| columns.values);
            let fit = |all, value: &f32| all & (value.abs() * factor <= part);
            values.iter().fold(true, fit)
        };
        let stored = self.accumulate.unwrap_or(0.0).abs() * 255.0 <= part;
        let fit = stored && within(self.scale, longest) && within(self.shift, 1.0);
        if fit && least <= 0.0 && most >= 255.0 {
            0
        } else {
            2
        }
    }

    /// The same for the rows and columns from a frame and a column on.
    pub(crate) fn from(self, frame: usize, column: usize) -> Self {
        Self {
            scale: self.scale.map(|scale| scale.from(frame, column)),
            shift: self.shift.map(|shift| shift.from(frame, column)),
            ..self
        }
    }
}

/// The product of gathered rows and a packed matrix.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Product<'a, W = f32> {
    pub(crate) source: &'a [W],
    pub(crate) rows: &'a [usize],
    /// Rows of one frame.
    pub(crate) frame_rows: usize,
    /// How far from a row's beginning each of its runs begins.
    pub(crate) taps: &'a [usize],
    /// Words of a run: `k` of the panels over the number of taps.
    pub(crate) run: usize,
    /// How far from the upper halves of numbers that are [split](super::split) the lower ones lie. The panels then hold
    /// two runs for each tap, one of each half.
    pub(crate) lower: Option<usize>,
    pub(crate) panels: PanelRun<'a, W>,
    pub(crate) epilogue: Epilogue<'a>,
}

impl<W: Word> Product<'_, W> {
    /// Writes row `i`, `n` numbers, at `places[i] - origin` of the target.
    ///
    /// Each sum runs over the taps and their elements in order, block by block: its bits do not
    /// depend on which other rows are computed with it.
    pub(crate) fn write(&self, target: &mut [W], places: &[usize], origin: usize) {
        debug_assert_eq!(self.taps.len() * self.run, self.panels.k);
        debug_assert_eq!(self.rows.len(), places.len());
        if const { W::NUMBERS > 1 } && Plan::of(self).is_some() {
            return self.write_by_tiles(target, places, origin);
        }
        let write = Write {
            product: self,
            target,
            places,
            origin,
        };
        W::run(self.panels.level, write);
    }

    /// The same by matrix tiles, into a map of any words. Nothing where tiles do not multiply it.
    pub(super) fn write_by_tiles<T: Word>(
        &self,
        target: &mut [T],
        places: &[usize],
        origin: usize,
    ) {
        if let Some(plan) = Plan::of(self) {
            let write = WriteTiles {
                plan,
                product: self,
                target,
                places,
                origin,
            };
            T::run(self.panels.level, write);
        }
    }

    /// The same by all threads of the pool, each of which has some columns of the panels and reads their
    /// weights alone.
    pub(crate) fn write_shared(&self, target: &mut [W], places: &[usize]) {
        let target = (target, places);
        write_shared(
            &[self.panels],
            target,
            self.epilogue,
            |panels, epilogue, block, rows| {
                let part = Product {
                    panels: panels[0],
                    epilogue,
                    ..*self
                };
                part.write(block, rows, 0);
            },
        );
    }

    /// Words of the source for each row, of which windows that overlap share some.
    pub(super) fn row_words(&self) -> usize {
        let span = match self.rows {
            [first, .., last] => last.abs_diff(*first) / (self.rows.len() - 1),
            _ => self.panels.k,
        };
        span.clamp(1, self.panels.k.max(1))
    }

    /// Has rows that are soon read brought near.
    #[inline(always)]
    fn prefetch_rows(&self, first: usize, count: usize) {
        // Of windows that overlap, the last run alone is new.
        let tap = self.taps.last().copied().unwrap_or_default();
        for &row in self.rows.iter().skip(first).take(count) {
            let from = row + tap;
            prefetch(&self.source[from..from + self.run], false);
        }
    }
}

/// The product of a row-major matrix and a packed one, row-major.
pub(crate) fn product_of_rows(x: &[f32], panels: &Panels, epilogue: Epilogue<'_>) -> Vec<f32> {
    let count = x.len() / panels.k;
    let mut out = vec![0.0; count * panels.n];
    let product = Product {
        source: x,
        rows: &starts(count, panels.k),
        frame_rows: count,
        taps: &[0],
        run: panels.k,
        lower: None,
        panels: panels.all(),
        epilogue,
    };
    product.write(&mut out, &starts(count, panels.n), 0);
    out
}

/// Has all threads of the pool write some columns each. The matrices, at least one, all have the same number of
/// columns and are cut alike: `write` is handed those columns of each, and fills a block of their own, whose rows begin
/// where it is told.
pub(super) fn write_shared<W: Word, P: Word>(
    matrices: &[PanelRun<'_, P>],
    (target, places): (&mut [W], &[usize]),
    epilogue: Epilogue<'_>,
    write: impl Fn(&[PanelRun<'_, P>], Epilogue<'_>, &mut [W], &[usize]) + Send + Sync,
) {
    let stored = &*target;
    let threads = rayon::current_num_threads();
    let runs: Vec<_> = matrices.iter().map(|all| all.split(threads)).collect();
    let compute = |(part, (run, block)): (usize, (&PanelRun<'_, P>, &mut Buffer<W>))| {
        let (first, width) = (W::words(run.column), W::words(run.n));
        *block = Buffer::zeros(places.len() * width);
        if epilogue.accumulate.is_some() {
            for (row, &place) in block.chunks_exact_mut(width).zip(places) {
                row.copy_from_slice(&stored[place + first..][..width]);
            }
        }
        let own: Vec<_> = runs.iter().map(|runs| runs[part]).collect();
        let rows = starts(places.len(), width);
        write(&own, epilogue.from(0, run.column), block, &rows);
    };
    let mut blocks = vec![Buffer::default(); runs[0].len()];
    let parts = runs[0].iter().zip(&mut blocks).enumerate();
    on_all_threads(parts.collect(), compute);
    for (run, block) in runs[0].iter().zip(&blocks) {
        let (first, width) = (W::words(run.column), W::words(run.n));
        for (row, &place) in block.chunks_exact(width).zip(places) {
            target[place + first..][..width].copy_from_slice(row);
        }
    }
}

struct Write<'a, 'b, W> {
    product: &'a Product<'b, W>,
    target: &'a mut [W],
    places: &'a [usize],
    origin: usize,
}

/// Words of f32 that are summed before their sum joins a longer one: rounding then grows with this
/// and with the number of blocks, not with a row's length. None where all are summed together:
/// beside the rounding of numbers to bf16, that of their sums in f32 is nothing, and sums of bytes are
/// exact.
const fn block<W: Word>() -> Option<usize> {
    if W::NUMBERS == 1 { Some(96) } else { None }
}

/// What a core's second-level cache holds beside what streams through it, in words.
pub(super) const CACHE: usize = 160 << 10;

impl<W: Word> WordKernel<W> for Write<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(self, lanes: S, arithmetic: A) {
        let (product, places, origin) = (self.product, self.places, self.origin);
        let tallest = tallest::<S>();
        let (k, n) = (product.panels.k, product.panels.n);
        let frame_rows = product.frame_rows.max(1);
        // Either the panels stay in the cache and each tile meets all of them, or a block of
        // frames stays and each panel meets all of it.
        let (frames, rows) = if k * n <= CACHE {
            (1, tallest)
        } else {
            let rows = (CACHE / product.row_words()).max(tallest);
            ((rows / frame_rows).max(1), rows.min(frame_rows))
        };
        let count = places.len().div_ceil(frame_rows);
        for block in (0..count).step_by(frames) {
            for start in (0..frame_rows).step_by(rows) {
                if k * n <= CACHE {
                    product.prefetch_rows(block * frame_rows + start + rows, rows);
                }
                for panel in product.panels.iter() {
                    for frame in block..(block + frames).min(count) {
                        let (from, to) = (frame * frame_rows, (frame + 1) * frame_rows);
                        let to = to.min(from + start + rows).min(places.len());
                        for (first, height) in tiles(from + start, to, tallest) {
                            let tile = Tile {
                                product,
                                panel,
                                frame,
                                first,
                                places: &places[first..first + height],
                                origin,
                                lanes,
                                arithmetic,
                            };
                            tile.write(self.target);
                        }
                    }
                }
            }
        }
    }
}

#[derive(Clone, Copy)]
struct Tile<'a, 'b, S: Lanes, A: Arithmetic<S>> {
    product: &'a Product<'b, A::Word>,
    panel: Panel<'a, A::Word>,
    frame: usize,
    first: usize,
    places: &'a [usize],
    origin: usize,
    lanes: S,
    arithmetic: A,
}

impl<S: Lanes, A: Arithmetic<S>> Tile<'_, '_, S, A> {
    #[inline(always)]
    fn write(self, target: &mut [A::Word]) {
        if self.panel.vectors == PANEL_VECTORS {
            self.write_vectors::<PANEL_VECTORS>(target);
        } else {
            self.write_vectors::<1>(target);
        }
    }

    #[inline(always)]
    fn write_vectors<const NV: usize>(self, target: &mut [A::Word]) {
        let tile = &self;
        with_height!(self.places.len(), S, H => {
            self.arithmetic.apart(
                self.lanes,
                #[inline(always)]
                move || tile.write_rows::<H, NV>(target),
            );
        });
    }

    /// The same of `H` rows and `NV` vectors.
    #[inline(always)]
    fn write_rows<const H: usize, const NV: usize>(&self, target: &mut [A::Word]) {
        let (panel, lanes, arithmetic) = (self.panel, self.lanes, self.arithmetic);
        let row = |i: usize| self.places[i] - self.origin + A::Word::words(panel.column);
        let epilogue = self.product.epilogue;
        // Of bytes, a tile's columns are half a cache line: what is only stored there waits for none.
        if !A::Word::WHOLE || epilogue.accumulate.is_some() {
            for i in 0..H {
                prefetch(&target[row(i)..][..A::Word::words(panel.columns)], true);
            }
        }
        let sums = self.sums::<H, NV>();
        let columns = (panel.column, panel.columns);
        let finish = Finish::<S, NV>::new(lanes, epilogue, self.frame, columns);
        if panel.columns < NV * S::F32_LANES {
            // A copy, so that the sums below are never in memory.
            #[allow(clippy::redundant_locals)]
            let sums = sums;
            for (i, sums) in sums.iter().enumerate() {
                let out = &mut target[row(i)..][..A::Word::words(panel.columns)];
                let mut stored = [lanes.splat_f32s(0.0); NV];
                if finish.accumulate {
                    stored = arithmetic.load_part(lanes, out);
                }
                let ended = finish.apply(lanes, arithmetic, sums, stored);
                arithmetic.store_part(lanes, ended, out);
            }
            return;
        }
        each_row!(H, i, {
            let out = &mut target[row(i)..][..A::Word::words(NV * S::F32_LANES)];
            let mut stored = [lanes.splat_f32s(0.0); NV];
            if finish.accumulate {
                stored = arithmetic.load(lanes, out);
            }
            let ended = finish.apply(lanes, arithmetic, &sums[i], stored);
            arithmetic.store::<NV>(lanes, ended, out);
        });
    }

    /// The tile of the product itself.
    #[inline(always)]
    fn sums<const H: usize, const NV: usize>(self) -> [[S::f32s; NV]; H] {
        let (lanes, arithmetic) = (self.lanes, self.arithmetic);
        let product = *self.product;
        let rows = &product.rows[self.first..self.first + H];
        let (panel, _) = S::as_simd_f32s(lanes_of(self.panel.data));
        let (panel, _) = panel.as_chunks::<NV>();
        let mut total = [[lanes.splat_f32s(0.0); NV]; H];
        let mut sums = total;
        let block = const { block::<A::Word>() };
        let length = block.unwrap_or(usize::MAX);
        let mut summed = 0;
        for (&tap, panel) in product.taps.iter().zip(panel.chunks_exact(product.run)) {
            let left: [&[f32]; H] = std::array::from_fn(|i| {
                let start = rows[i] + tap;
                lanes_of(&product.source[start..start + product.run])
            });
            for (part, panel) in panel.chunks(length).enumerate() {
                let from = part * length;
                let left: [&[f32]; H] = std::array::from_fn(|i| &left[i][from..from + panel.len()]);
                for p in 0..panel.len() {
                    let right = panel[p];
                    for i in 0..H {
                        let x = lanes.splat_f32s(left[i][p]);
                        for v in 0..NV {
                            sums[i][v] = arithmetic.multiply_add(lanes, x, right[v], sums[i][v]);
                        }
                    }
                }
                summed += panel.len();
                if block.is_some() && summed >= length {
                    summed = 0;
                    each_row!(H, i, {
                        for v in 0..NV {
                            total[i][v] = lanes.add_f32s(total[i][v], sums[i][v]);
                            sums[i][v] = lanes.splat_f32s(0.0);
                        }
                    });
                }
            }
        }
        if block.is_some() {
            each_row!(H, i, {
                for v in 0..NV {
                    sums[i][v] = lanes.add_f32s(total[i][v], sums[i][v]);
                }
            });
        }
        sums
    }
}

/// The epilogue of some columns of a frame. Vectors are aligned to single numbers: in a list, most would straddle two
/// cache lines.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Finish<S: Lanes, const NV: usize> {
    scale: [S::f32s; NV],
    shift: [S::f32s; NV],
    limits: [S::f32s; 2],
    /// Whether what is stored is added.
    pub(super) accumulate: bool,
    factor: S::f32s,
}

impl<S: Lanes, const NV: usize> Finish<S, NV> {
    /// Of a frame, from a column on, so many.
    #[inline(always)]
    pub(super) fn new(
        lanes: S,
        epilogue: Epilogue<'_>,
        frame: usize,
        columns: (usize, usize),
    ) -> Self {
        let scale = vectors(lanes, epilogue.scale, frame, columns, 1.0);
        let shift = vectors(lanes, epilogue.shift, frame, columns, 0.0);
        Self::of_vectors(lanes, epilogue, scale, shift)
    }

    /// By factors and shifts in vectors.
    #[inline(always)]
    pub(super) fn of_vectors(
        lanes: S,
        epilogue: Epilogue<'_>,
        scale: [S::f32s; NV],
        shift: [S::f32s; NV],
    ) -> Self {
        let [least, most] = epilogue.limits;
        Self {
            scale,
            shift,
            limits: [lanes.splat_f32s(least), lanes.splat_f32s(most)],
            accumulate: epilogue.accumulate.is_some(),
            factor: lanes.splat_f32s(epilogue.accumulate.unwrap_or(1.0)),
        }
    }

    /// What is stored of a row's sums, where `stored` is stored already. By a closure, which is faster here.
    #[inline(always)]
    fn apply<A: Arithmetic<S>>(
        self,
        lanes: S,
        arithmetic: A,
        sums: &[S::f32s; NV],
        stored: [S::f32s; NV],
    ) -> [S::f32s; NV] {
        std::array::from_fn(|v| {
            let sum = arithmetic.numbers(lanes, sums[v]);
            self.apply_some::<A, 2>(lanes, arithmetic, v, sum, stored[v])
        })
    }

    /// Ends a row's sums by so many of the limits and stores them; `WHOLE` where they fill the vectors.
    #[inline(always)]
    pub(super) fn store<A: Arithmetic<S>, const WHOLE: bool, const LIMITS: usize>(
        self,
        lanes: S,
        arithmetic: A,
        sums: [S::f32s; NV],
        out: &mut [A::Word],
    ) {
        let mut stored = [lanes.splat_f32s(0.0); NV];
        if self.accumulate {
            stored = arithmetic.read::<NV, WHOLE>(lanes, out);
        }
        // A closure of as much is not inlined, and runs without the instructions.
        let mut ended = sums;
        for v in 0..NV {
            let sum = arithmetic.numbers(lanes, ended[v]);
            ended[v] = self.apply_some::<A, LIMITS>(lanes, arithmetic, v, sum, stored[v]);
        }
        arithmetic.write::<NV, WHOLE>(lanes, ended, out);
    }

    /// What is stored of the numbers of one vector by so many of the limits, where `stored` is stored already.
    #[inline(always)]
    pub(super) fn apply_some<A: Arithmetic<S>, const LIMITS: usize>(
        self,
        lanes: S,
        arithmetic: A,
        v: usize,
        sum: S::f32s,
        stored: S::f32s,
    ) -> S::f32s {
        let y = arithmetic.scale_add(lanes, sum, self.scale[v], self.shift[v]);
        let y = if self.accumulate {
            arithmetic.scale_add(lanes, stored, self.factor, y)
        } else {
            y
        };
        match LIMITS {
            0 => y,
            1 => lanes.at_least(self.limits[0], y),
            _ => lanes.within(self.limits, y),
        }
    }
}

/// The numbers of columns from one on, so many.
#[inline(always)]
fn vectors<S: Lanes, const NV: usize>(
    lanes: S,
    columns: Option<Columns<'_>>,
    frame: usize,
    (column, count): (usize, usize),
    default: f32,
) -> [S::f32s; NV] {
    let Some(columns) = columns else {
        return [lanes.splat_f32s(default); NV];
    };
    let values = &columns.from(frame, column).values[..count];
    let mut vectors = [lanes.splat_f32s(default); NV];
    // No closure: one that is not inlined is compiled without the instructions.
    for (v, vector) in vectors.iter_mut().enumerate() {
        if let Some(values) = values.get(v * S::F32_LANES..) {
            *vector = load(lanes, values);
        }
    }
    vectors
}
