//! Max pooling of feature maps, channels last.

use sps_base::parallel;

use super::bands::{Band, Threads, chunks, for_each_band};
use super::buffer::Buffer;
use super::grid::{Grid, Size, Window, pixels};
use super::simd::{Kernel, Lanes, Level};
use super::words::{Arithmetic, Real, Word, WordKernel, lanes_of, vectors};

/// Writes to each pixel of `target` the largest values under the window.
///
/// The window sees the border of `from`, which must reach as far as the window's padding at the
/// lower ends; where it hangs over the border's upper end, it sees only what there is.
pub(crate) fn max_pool<W: Word>(
    threads: Threads,
    level: Level,
    window: &Window,
    (source, from): (&[W], &Grid),
    (target, to): (&mut [W], &Grid),
) {
    let places = to.places();
    for_each_band(threads, to, target, |band| {
        level.run(Pool {
            window,
            source,
            from,
            to,
            places: &places,
            band,
            columns: Buffer::default(),
        });
    });
}

/// Whole rows.
struct Pool<'a, 'b, W> {
    window: &'a Window,
    source: &'a [W],
    from: &'a Grid,
    to: &'a Grid,
    /// Where each pixel of the whole target lies.
    places: &'a [usize],
    band: Band<'b, W>,
    /// Of each column of the source the largest of its pixels, which windows side by side share.
    columns: Buffer,
}

impl<W: Word> Kernel for Pool<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(mut self, lanes: S) {
        let Self {
            window, from, to, ..
        } = self;
        let width = to.size[2].max(1);
        let mut rows = Vec::new();
        for pixels in chunks(self.band.pixels.clone(), width) {
            let corner = Corner::new(window, from, to, pixels.start);
            let places = &self.places[pixels];
            rows.clear();
            rows.extend(corner.rows(from));
            // The last window may hang over the end.
            let reach = (width - 1) * window.stride[2] + window.size[2];
            let seen = reach.min(corner.room[2]);
            let mut word = 0;
            while word + VECTORS * S::F32_LANES <= from.words {
                self.line::<S, VECTORS, true>(lanes, (&rows, seen), places, word);
                word += VECTORS * S::F32_LANES;
            }
            while word + S::F32_LANES <= from.words {
                self.line::<S, 1, true>(lanes, (&rows, seen), places, word);
                word += S::F32_LANES;
            }
            if word < from.words {
                self.line::<S, 1, false>(lanes, (&rows, seen), places, word);
            }
        }
    }
}

/// Vectors that are compared together.
const VECTORS: usize = 4;

impl<W: Word> Pool<'_, '_, W> {
    /// `NV` vectors of a row of pixels, from `word` on; `WHOLE` if there are as many. The windows see some columns of
    /// rows that begin so.
    #[inline(always)]
    fn line<S: Lanes, const NV: usize, const WHOLE: bool>(
        &mut self,
        lanes: S,
        (rows, seen): (&[usize], usize),
        places: &[usize],
        word: usize,
    ) {
        let [first, others @ ..] = rows else { return };
        let words = (self.from.words - word).min(NV * S::F32_LANES);
        let (source, pitch) = (self.source, self.from.pitch);
        let read = |row: usize, x: usize| {
            let at = row + x * pitch + word;
            vectors::<S, NV, WHOLE>(lanes, lanes_of(&source[at..at + words]))
        };
        let step = NV * S::F32_LANES;
        self.columns.resize(seen * step);
        let (columns, _) = S::as_mut_simd_f32s(&mut self.columns)
            .0
            .as_chunks_mut::<NV>();
        for (x, column) in columns.iter_mut().enumerate() {
            let mut largest = read(*first, x);
            for &row in others {
                keep_larger::<W, S, NV>(lanes, &mut largest, read(row, x));
            }
            *column = largest;
        }
        let (size, stride) = (self.window.size[2], self.window.stride[2]);
        for (x, &place) in places.iter().enumerate() {
            let under = &columns[x * stride..(x * stride + size).min(seen)];
            let [first, others @ ..] = under else { return };
            let mut largest = *first;
            for &column in others {
                keep_larger::<W, S, NV>(lanes, &mut largest, column);
            }
            let place = place - self.band.origin + word;
            let out = bytemuck::cast_slice_mut(&mut self.band.target[place..place + words]);
            if WHOLE {
                S::as_mut_simd_f32s(out).0[..NV].copy_from_slice(&largest);
            } else {
                lanes.partial_store_f32s(out, largest[0]);
            }
        }
    }
}

/// Takes over each number that is the larger one.
#[inline(always)]
fn keep_larger<W: Word, S: Lanes, const NV: usize>(
    lanes: S,
    largest: &mut [S::f32s; NV],
    others: [S::f32s; NV],
) {
    for (largest, other) in largest.iter_mut().zip(others) {
        *largest = W::larger(lanes, *largest, other);
    }
}

/// Where a window begins.
struct Corner {
    /// The index of its first pixel.
    start: usize,
    /// How many times, rows and columns there are from there, with the border.
    room: Size,
    /// How many of them the window sees.
    size: Size,
}

impl Corner {
    /// The window of a pixel, whose number counts over all frames.
    #[inline(always)]
    fn new(window: &Window, from: &Grid, to: &Grid, pixel: usize) -> Self {
        let [time, height, width] = to.size;
        let place = [
            pixel / (height * width) % time,
            pixel / width % height,
            pixel % width,
        ];
        let frame = pixel / pixels(to.size);
        let corner = std::array::from_fn(|axis| {
            from.before[axis] - window.before[axis] + place[axis] * window.stride[axis]
        });
        let room = std::array::from_fn(|axis| from.extent(axis).saturating_sub(corner[axis]));
        Self {
            start: from.index(frame, corner),
            size: std::array::from_fn(|axis| window.size[axis].min(room[axis])),
            room,
        }
    }

    /// Where its rows begin.
    #[inline(always)]
    fn rows(&self, from: &Grid) -> impl Iterator<Item = usize> {
        let [times, height, _] = self.size;
        let row = |t: usize, y: usize| self.start + from.index(0, [t, y, 0]);
        (0..times).flat_map(move |t| (0..height).map(move |y| row(t, y)))
    }
}

/// Writes the gradient of max pooling's input: each window's gradient goes to the first of its
/// largest values. The border of `from` gets its part too. `gradient` lies as `pooled` does, without
/// a border.
pub(crate) fn max_pool_backward<W: Real>(
    level: Level,
    window: &Window,
    (source, from): (&[W], &Grid),
    (pooled, to): (&[W], &Grid),
    gradient: &[W],
    target: &mut [W],
) {
    let places = to.places();
    let pixels = pixels(to.size);
    let frames = target.chunks_mut(from.frame_len().max(1)).enumerate();
    parallel::each(frames, |(frame, target)| {
        let backward = PoolBackward {
            window,
            source,
            from,
            pooled,
            to,
            gradient,
            first: frame * pixels,
            places: &places[frame * pixels..(frame + 1) * pixels],
            target,
            origin: frame * from.frame_len(),
        };
        W::run(level, backward);
    });
}

/// One frame.
struct PoolBackward<'a, W> {
    window: &'a Window,
    source: &'a [W],
    from: &'a Grid,
    pooled: &'a [W],
    to: &'a Grid,
    gradient: &'a [W],
    /// The number of its first pixel, and where each lies.
    first: usize,
    places: &'a [usize],
    target: &'a mut [W],
    origin: usize,
}

impl<W: Real> WordKernel<W> for PoolBackward<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(mut self, lanes: S, arithmetic: A) {
        self.target.fill(W::default());
        let (words, step) = (self.from.words, W::words(S::F32_LANES));
        for (pixel, &place) in (self.first..).zip(self.places) {
            let corner = Corner::new(self.window, self.from, self.to, pixel);
            let ends = (place, pixel * self.to.pitch);
            let mut word = 0;
            while word + step <= words {
                self.give::<S, A, true>(lanes, arithmetic, &corner, ends, (word, step));
                word += step;
            }
            if word < words {
                self.give::<S, A, false>(lanes, arithmetic, &corner, ends, (word, words - word));
            }
        }
    }
}

impl<W: Real> PoolBackward<'_, W> {
    /// Hands the gradient of a pixel's words from one on to the first of the largest values; `WHOLE` if they fill
    /// a vector.
    #[inline(always)]
    fn give<S: Lanes, A: Arithmetic<S, Word = W>, const WHOLE: bool>(
        &mut self,
        lanes: S,
        arithmetic: A,
        corner: &Corner,
        (place, own): (usize, usize),
        (word, words): (usize, usize),
    ) {
        let read = |memory: &[W], at: usize| {
            let memory = &memory[at + word..at + word + words];
            let [numbers] = arithmetic.read::<1, WHOLE>(lanes, memory);
            numbers
        };
        let zero = lanes.splat_f32s(0.0);
        let largest = read(self.pooled, place);
        let mut left = read(self.gradient, own);
        for row in corner.rows(self.from) {
            for x in 0..corner.size[2] {
                let at = row + x * self.from.pitch;
                let found = lanes.equal_f32s(read(self.source, at), largest);
                let given = lanes.select_f32s(found, left, zero);
                left = lanes.select_f32s(found, zero, left);
                let at = at - self.origin;
                let sum = lanes.add_f32s(read(self.target, at), given);
                let out = &mut self.target[at + word..at + word + words];
                if WHOLE {
                    arithmetic.store(lanes, [sum], out);
                } else {
                    arithmetic.store_part(lanes, [sum], out);
                }
            }
        }
    }
}
