//! The gradient of a convolution's input.
//!
//! With stride 1 it is a convolution of the output's gradient with the window turned round. With
//! a stride, the input's pixels fall into phases, one for each remainder of the stride; each
//! phase is such a convolution, by the part of the window that reaches it.

use super::bands::Threads;
use super::conv::ConvShape;
use super::grid::{Grid, Size};
use super::phases::{self, Lattice, Packed, convolve};
use super::product::Epilogue;
use super::simd::Level;
use super::winograd::{Reach, Winograd};
use super::words::Real;

/// The transpose of a convolution, with its weights laid out for the kernels.
#[derive(Debug, Clone)]
pub(crate) struct ConvTranspose<W = f32> {
    shape: ConvShape,
    phases: Vec<Phase<W>>,
}

#[derive(Debug, Clone)]
struct Phase<W> {
    lattice: Lattice,
    /// How far from a pixel's number within the phase the output's pixels lie that it feeds.
    offsets: Vec<[isize; 3]>,
    packed: Packed<W>,
}

impl<W: Real> ConvTranspose<W> {
    /// Packs weights `(outputs, inputs / groups, time, height, width)`.
    pub(crate) fn pack(level: Level, shape: ConvShape, weights: &[f32]) -> Self {
        if let Some((shape, weights)) = shape.joined::<W>(level, weights) {
            return Self::pack(level, shape, &weights);
        }
        let words = W::of_weights(level, weights);
        let phase = |first| Phase::pack(level, &shape, first, (weights, &words));
        let phases = places(shape.window.stride).map(phase).collect();
        Self { shape, phases }
    }

    /// The layout of the output's gradient, with as large a border of zeros as the phases reach over.
    pub(crate) fn layout(&self, frames: usize, input: Size, output: Size) -> Grid {
        let mut grid = Grid::tight(frames, output, self.shape.outputs).of::<W>();
        for phase in &self.phases {
            let count = phase.lattice.count(input);
            for offset in &phase.offsets {
                for axis in 0..3 {
                    let last = count[axis] as isize - 1 + offset[axis];
                    let over = (last + 1 - output[axis] as isize).max(0) as usize;
                    let under = (-offset[axis]).max(0) as usize;
                    if count[axis] > 0 {
                        grid.before[axis] = grid.before[axis].max(under);
                        grid.after[axis] = grid.after[axis].max(over);
                    }
                }
            }
        }
        grid
    }

    /// Writes the input's gradient, or adds it to what `target` holds.
    ///
    /// `from` is what [`ConvTranspose::layout`] says.
    pub(crate) fn apply(
        &self,
        (gradient, from): (&[W], &Grid),
        (target, to): (&mut [W], &Grid),
        accumulate: bool,
    ) {
        let epilogue = Epilogue {
            accumulate: accumulate.then_some(1.0),
            ..Epilogue::default()
        };
        let phases: Vec<_> = self.phases.iter().map(|phase| phase.on(from)).collect();
        if let [phase, ..] = &phases[..]
            && let Some(winograd) = self.winograd(phase, to.size)
        {
            let phases::Reach { mut starts, places } = phase.lattice.whole_reach(from, to);
            // Turned round, the window begins where its last tap does.
            let first = phase.taps.last().copied().unwrap_or_default();
            for start in &mut starts {
                *start += first;
            }
            let reach = Reach {
                source: gradient,
                from,
                starts: &starts,
                to,
                places: &places,
            };
            winograd.apply(Threads::All, reach, target, epilogue);
            return;
        }
        let ends = ((gradient, from), (target, to));
        convolve(&phases, Threads::All, ends.0, ends.1, epilogue);
    }

    /// A phase by fewer products, to maps of such a size, where that is worth it.
    fn winograd(&self, phase: &phases::Phase<'_, W>, size: Size) -> Option<Winograd> {
        let matrix = phase.packed.matrix().filter(|_| Winograd::serves(size))?;
        let ends = [self.shape.outputs, self.shape.inputs];
        Winograd::of(Threads::All, &self.shape.window, ends, matrix, true)
    }
}

impl<W: Real> Phase<W> {
    fn pack(level: Level, shape: &ConvShape, first: Size, weights: (&[f32], &[W])) -> Self {
        let window = &shape.window;
        let reaches = |tap: Size| {
            let mut offset = [0; 3];
            for axis in 0..3 {
                let distance = (first[axis] + window.before[axis]) as isize - tap[axis] as isize;
                let stride = window.stride[axis] as isize;
                if distance.rem_euclid(stride) != 0 {
                    return None;
                }
                offset[axis] = distance.div_euclid(stride);
            }
            Some(offset)
        };
        let taps = places(window.size).enumerate();
        let taps = taps.filter_map(|(index, tap)| Some((index, reaches(tap)?)));
        let (taps, offsets): (Vec<usize>, Vec<_>) = taps.unzip();
        Self {
            lattice: Lattice {
                first,
                step: window.stride,
                // From the border's corner; the offsets, which may be negative, lead back inside it.
                start: [0; 3],
                stride: [1; 3],
            },
            packed: Packed::pack(level, shape, &taps, weights, true),
            offsets,
        }
    }

    /// Of a gradient that lies so.
    fn on(&self, from: &Grid) -> phases::Phase<'_, W> {
        let tap = |offset: &[isize; 3]| {
            let place = std::array::from_fn(|axis| {
                (from.before[axis] as isize + offset[axis]).max(0) as usize
            });
            from.index(0, place)
        };
        phases::Phase {
            lattice: self.lattice,
            taps: self.offsets.iter().map(tap).collect(),
            packed: &self.packed,
        }
    }
}

/// Every place of a box, row by row.
fn places(size: Size) -> impl Iterator<Item = Size> {
    let [time, height, width] = size;
    (0..time * height * width).map(move |i| [i / (height * width), i / width % height, i % width])
}
