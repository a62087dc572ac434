//! Rows of a convolution, which weights of several kinds are made for.

use std::ops::Range;

use super::panels::Panels;
use super::product::{Epilogue, Product};
use super::simd::{Lanes, Level};
use super::words::{Arithmetic, Word, WordKernel};

/// Pixels of the output of a convolution over a source that has its padding around it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows<'a, W> {
    pub(super) source: &'a [W],
    /// Where the window begins for each pixel.
    pub(super) starts: &'a [usize],
    /// How far from there its runs begin.
    pub(super) taps: &'a [usize],
    /// Words from one pixel of the source to the next.
    pub(super) pitch: usize,
    /// Pixels from one place of the window to the next in a row.
    pub(super) stride: usize,
    /// Pixels of one frame.
    pub(super) per_frame: usize,
    /// Where each pixel goes, of which `origin` is taken off.
    pub(super) places: &'a [usize],
    pub(super) origin: usize,
    /// What happens to the sums; only matrices have factors and shifts of each frame's own.
    pub(super) epilogue: Epilogue<'a>,
}

/// Weights that rows are convolved by.
pub(super) trait RowWeights<W: Word>: Sized {
    /// The level whose vectors they are laid out for.
    fn level(&self) -> Level;

    /// Writes pixel `i` at `places[i] - origin` of the target; inlined as [`Kernel::run`](super::simd::Kernel::run).
    fn write<S: Lanes, A: Arithmetic<S, Word = W>>(writer: Writer<'_, W, Self, S, A>);
}

/// What writes rows by one set of instructions.
pub(super) struct Writer<'a, W, P, S, A> {
    // By value: behind a pointer, they would be read again after each number that is written.
    pub(super) rows: Rows<'a, W>,
    pub(super) weights: &'a P,
    pub(super) target: &'a mut [W],
    pub(super) lanes: S,
    pub(super) arithmetic: A,
}

impl<'a, W: Word> Rows<'a, W> {
    /// Runs of pixels whose windows lie `stride` pixels from each other in a row.
    pub(super) fn side_by_side(&self) -> impl Iterator<Item = Range<usize>> + use<'a, W> {
        let (starts, step) = (self.starts, self.stride * self.pitch);
        let runs = starts.chunk_by(move |start, next| *next == start + step);
        runs.scan(0, |first, run| {
            let pixels = *first..*first + run.len();
            *first = pixels.end;
            Some(pixels)
        })
    }

    /// The product by the matrix of a group, whose columns begin with this one.
    pub(super) fn product(
        &self,
        panels: &'a Panels<W>,
        group: usize,
        column: usize,
    ) -> Product<'a, W> {
        let run = panels.k / self.taps.len();
        Product {
            source: &self.source[group * run..],
            rows: self.starts,
            frame_rows: self.per_frame,
            taps: self.taps,
            run,
            lower: None,
            panels: panels.all(),
            epilogue: self.epilogue.from(0, column),
        }
    }

    /// Convolves the rows into the target.
    pub(super) fn write<P: RowWeights<W>>(&self, weights: &P, target: &mut [W]) {
        W::run(weights.level(), Write(self, weights, target));
    }
}

struct Write<'a, W, P>(&'a Rows<'a, W>, &'a P, &'a mut [W]);

impl<W: Word, P: RowWeights<W>> WordKernel<W> for Write<'_, W, P> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(self, lanes: S, arithmetic: A) {
        let Self(rows, weights, target) = self;
        P::write(Writer {
            rows: *rows,
            weights,
            target,
            lanes,
            arithmetic,
        });
    }
}
