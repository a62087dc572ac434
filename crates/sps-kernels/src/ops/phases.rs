//! A convolution as a list of phases, each of which makes some pixels of the output by weights of its own: one phase
//! forward, several of images, one for each remainder of the stride backward.

use std::ops::Range;

use super::bands::{Threads, for_each_band};
use super::conv::ConvShape;
use super::depthwise::ChannelWeights;
use super::depthwise_bytes::QuadWeights;
use super::grid::{Grid, Size, Window, pixels};
use super::grouped::GroupWeights;
use super::panels::Panels;
use super::product::Epilogue;
use super::rows::Rows;
use super::simd::Level;
use super::words::Word;

/// Every `step`th pixel of the output from the `first` on; windows begin at every `stride`th pixel of the source from
/// `start` on, counted with the border.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lattice {
    pub(super) first: Size,
    pub(super) step: Size,
    pub(super) start: Size,
    pub(super) stride: Size,
}

/// Where windows begin, and their pixels of the output.
pub(super) struct Reach {
    pub(super) starts: Vec<usize>,
    pub(super) places: Vec<usize>,
}

impl Lattice {
    /// All pixels, by a window over a source.
    pub(super) fn of_window(window: &Window, from: &Grid) -> Self {
        Self {
            first: [0; 3],
            step: [1; 3],
            start: [0, 1, 2].map(|axis| from.before[axis] - window.before[axis]),
            stride: window.stride,
        }
    }

    /// Its pixels along each axis of an output.
    pub(super) fn count(&self, output: Size) -> Size {
        [0, 1, 2].map(|axis| self.before(axis, output[axis]))
    }

    /// How many of them lie before a place of an axis.
    fn before(&self, axis: usize, place: usize) -> usize {
        place
            .saturating_sub(self.first[axis])
            .div_ceil(self.step[axis])
    }

    /// Those of its rows that lie within some of the output, counted over all frames.
    pub(super) fn rows_within(&self, rows: Range<usize>, output: Size) -> Range<usize> {
        let ([time, height, _], [times, heights, _]) = (output, self.count(output));
        let before = |row: usize| {
            let (frame, t, y) = (row / height / time, row / height % time, row % height);
            let own = t % self.step[0] == self.first[0] % self.step[0];
            let of_time = if own { self.before(1, y) } else { 0 };
            (frame * times + self.before(0, t)) * heights + of_time
        };
        before(rows.start)..before(rows.end)
    }

    /// Of some of its rows, counted over all frames.
    pub(super) fn reach(&self, rows: Range<usize>, from: &Grid, to: &Grid) -> Reach {
        let count = self.count(to.size);
        let first = [0, 1, 2].map(|axis| to.before[axis] + self.first[axis]);
        Reach {
            starts: from.steps(rows.clone(), self.start, count, self.stride),
            places: to.steps(rows, first, count, self.step),
        }
    }

    /// Of all of them.
    pub(super) fn whole_reach(&self, from: &Grid, to: &Grid) -> Reach {
        self.reach(self.rows_within(to.rows(), to.size), from, to)
    }
}

/// The weights of a phase.
#[derive(Debug, Clone)]
pub(super) enum Packed<W> {
    /// None: sums of nothing, so many words of each pixel.
    Nothing(usize),
    /// Each group as a matrix.
    Matrices(Vec<Panels<W>>),
    /// Groups narrower than a vector.
    Narrow(GroupWeights<W>),
    /// Each channel by itself.
    Channels(ChannelWeights),
    /// Each channel by itself, in bytes.
    Quads(QuadWeights<W>),
}

impl<W: Word> Packed<W> {
    /// Packs some taps of weights `(outputs, inputs / groups, time, height, width)`, as they are and as words: for sums
    /// over inputs, or `backward` over outputs.
    pub(super) fn pack(
        level: Level,
        shape: &ConvShape,
        taps: &[usize],
        (weights, words): (&[f32], &[W]),
        backward: bool,
    ) -> Self {
        let window = pixels(shape.window.size);
        let (inputs, outputs) = (shape.group_inputs(), shape.group_outputs());
        // Of a group, what a sum runs over and how many sums there are; how far apart their weights lie.
        let ([depth, columns], [step, next]) = if backward {
            ([outputs, inputs], [inputs * window, window])
        } else {
            ([inputs, outputs], [window, inputs * window])
        };
        let channels = shape.groups * columns;
        if taps.is_empty() {
            return Self::Nothing(W::words(channels));
        }
        if shape.depthwise() {
            let width = shape.window.size[2];
            if W::WHOLE {
                let window = [window / width, width];
                return Self::Quads(QuadWeights::pack(level, window, weights));
            }
            // Rounded to bf16, few weights that all but cancel each other would move sums too far.
            let in_row = |tap: &&usize| *tap / width == taps[0] / width;
            let taps = (taps, taps.iter().take_while(in_row).count());
            return Self::Channels(ChannelWeights::pack(level, taps, window, weights));
        }
        debug_assert!(inputs.is_multiple_of(W::NUMBERS), "{shape:?}");
        debug_assert!(outputs.is_multiple_of(W::NUMBERS), "{shape:?}");
        let group_len = outputs * inputs * window;
        let numbers = W::each(words);
        if depth == columns && GroupWeights::<W>::serves(level, channels, columns) {
            let element = |channel: usize, tap: usize, i: usize| {
                let first = if backward {
                    channel / columns * group_len + channel % columns * next
                } else {
                    channel * next
                };
                numbers[first + i * step + taps[tap]]
            };
            let taps = taps.len();
            return Self::Narrow(GroupWeights::pack(level, channels, columns, taps, element));
        }
        let group = |group: usize| {
            let matrix = &words[W::words(group * group_len)..];
            if step == 1 {
                return Panels::pack_transposed(level, W::words(depth), columns, matrix);
            }
            if next == 1 && W::NUMBERS == 1 {
                return Panels::pack_rows(level, depth, columns, matrix);
            }
            let rows = [taps.len(), W::words(depth)];
            Panels::pack(level, rows, columns, |tap, word, column| {
                let first = group * group_len + column * next + taps[tap];
                W::gathered(|i| numbers[first + (W::NUMBERS * word + i) * step])
            })
        };
        Self::Matrices((0..shape.groups).map(group).collect())
    }

    /// The matrix of the only group.
    pub(super) fn matrix(&self) -> Option<&Panels<W>> {
        match self {
            Self::Matrices(groups) if groups.len() == 1 => groups.first(),
            _ => None,
        }
    }

    fn write(&self, rows: &Rows<'_, W>, target: &mut [W]) {
        match self {
            Self::Nothing(words) if rows.epilogue.accumulate.is_none() => {
                for place in rows.places {
                    target[place - rows.origin..][..*words].fill(W::default());
                }
            }
            Self::Narrow(weights) => rows.write(weights, target),
            Self::Channels(weights) if const { !W::WHOLE } => rows.write(weights, target),
            Self::Quads(weights) if const { W::WHOLE } => rows.write(weights, target),
            Self::Matrices(groups) => {
                let mut column = 0;
                for (group, panels) in groups.iter().enumerate() {
                    let product = rows.product(panels, group, column);
                    product.write(&mut target[W::words(column)..], rows.places, rows.origin);
                    column += panels.n;
                }
            }
            // Channels are never packed from whole numbers, nor quads from others: this keeps kernels for such words from
            // being compiled.
            Self::Nothing(_) | Self::Channels(_) | Self::Quads(_) => {}
        }
    }
}

/// A phase of a convolution between two maps.
#[derive(Debug)]
pub(super) struct Phase<'a, W> {
    pub(super) lattice: Lattice,
    /// How far from a window's beginning its runs begin.
    pub(super) taps: Vec<usize>,
    pub(super) packed: &'a Packed<W>,
}

/// Convolves `source`, which lies as `from` says, into `target`, as `to` says.
pub(super) fn convolve<W: Word>(
    phases: &[Phase<'_, W>],
    threads: Threads,
    (source, from): (&[W], &Grid),
    (target, to): (&mut [W], &Grid),
    epilogue: Epilogue<'_>,
) {
    let (heavy, light): (Vec<_>, Vec<_>) = phases.iter().partition(|phase| {
        let outweigh = |panels: &Panels<W>| panels.outweigh(from, to);
        threads == Threads::All && phase.packed.matrix().is_some_and(outweigh)
    });
    for phase in heavy {
        let reach = phase.lattice.whole_reach(from, to);
        // Where none has factors of its own, frames are walked as one, by taller tiles.
        let frames = if epilogue.per_frame() { to.frames } else { 1 };
        let rows = phase.rows((source, from.pitch), &reach, (frames, 0), epilogue);
        if let Some(panels) = phase.packed.matrix() {
            rows.product(panels, 0, 0)
                .write_shared(target, &reach.places);
        }
    }
    if light.is_empty() {
        return;
    }
    for_each_band(threads, to, target, |band| {
        let epilogue = epilogue.from(band.frames.start, 0);
        for phase in &light {
            let rows = phase.lattice.rows_within(band.rows(to), to.size);
            let reach = phase.lattice.reach(rows, from, to);
            let part = (band.frames.len(), band.origin);
            let rows = phase.rows((source, from.pitch), &reach, part, epilogue);
            phase.packed.write(&rows, band.target);
        }
    });
}

impl<W> Phase<'_, W> {
    fn rows<'a>(
        &'a self,
        (source, pitch): (&'a [W], usize),
        reach: &'a Reach,
        (frames, origin): (usize, usize),
        epilogue: Epilogue<'a>,
    ) -> Rows<'a, W> {
        Rows {
            source,
            starts: &reach.starts,
            taps: &self.taps,
            pitch,
            stride: self.lattice.stride[2],
            per_frame: reach.places.len() / frames.max(1),
            places: &reach.places,
            origin,
            epilogue,
        }
    }
}
