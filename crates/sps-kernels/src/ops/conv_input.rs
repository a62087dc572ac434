//! The gradient of a convolution's input.
//!
//! With stride 1 it is a convolution of the output's gradient with the window turned round. With
//! a stride, the input's pixels fall into phases, one for each remainder of the stride; each
//! phase is such a convolution, by the part of the window that reaches it.

use super::bands::{Threads, for_each_band};
use super::conv::ConvShape;
use super::depthwise::{ChannelWeights, DepthwiseProduct};
use super::grid::{Grid, Size, pixels};
use super::grouped::{GroupWeights, GroupedProduct};
use super::panels::Panels;
use super::product::{Epilogue, Product};
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
    /// The first pixel of the phase.
    first: Size,
    /// How far from a pixel's number within the phase the output's pixels lie that it feeds.
    offsets: Vec<[isize; 3]>,
    packed: Packed<W>,
}

/// The part of the weights that reaches a phase.
#[derive(Debug, Clone)]
enum Packed<W> {
    /// No pixel of the phase is under the window anywhere.
    None,
    /// `(offsets * group outputs, group inputs)` for each group.
    Matrices(Vec<Panels<W>>),
    /// Groups narrower than a vector.
    Narrow(GroupWeights<W>),
    /// Each channel by itself.
    Channels(ChannelWeights),
}

impl<W: Real> ConvTranspose<W> {
    /// Packs weights `(outputs, inputs / groups, time, height, width)`.
    pub(crate) fn pack(level: Level, shape: ConvShape, weights: &[f32]) -> Self {
        if let Some((shape, weights)) = shape.joined::<W>(level, weights) {
            return Self::pack(level, shape, &weights);
        }
        let words = W::of_weights(level, weights);
        let phases = places(shape.window.stride)
            .map(|first| Phase::pack(level, &shape, first, (weights, &words)))
            .collect();
        Self { shape, phases }
    }

    /// The layout that the output's gradient must have: as large a border of zeros as the phases
    /// reach over.
    pub(crate) fn layout(&self, frames: usize, input: Size, output: Size) -> Grid {
        let mut grid = Grid::tight(frames, output, self.shape.outputs).of::<W>();
        for phase in &self.phases {
            let count = phase.count(input, self.shape.window.stride);
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
        let stride = self.shape.window.stride;
        let tables: Vec<_> = self
            .phases
            .iter()
            .map(|phase| phase.table(from, to, stride))
            .collect();
        let epilogue = Epilogue {
            accumulate: accumulate.then_some(1.0),
            ..Epilogue::default()
        };
        let phases = || self.phases.iter().zip(&tables);
        if let Some((phase, table)) = phases().next()
            && let Some(winograd) = self.winograd(phase, to.size)
        {
            // Turned round, the window begins where its last tap does.
            let first = table.taps.last().copied().unwrap_or_default();
            let starts: Vec<usize> = table.starts.iter().map(|start| start + first).collect();
            let reach = Reach {
                source: gradient,
                from,
                starts: &starts,
                to,
                places: &table.places,
            };
            winograd.apply(Threads::All, reach, target, epilogue);
            return;
        }
        let (heavy, light): (Vec<_>, Vec<_>) = phases().partition(|(phase, _)| {
            let panels = phase.packed.matrix();
            panels.is_some_and(|panels| panels.outweigh(from, to))
        });
        for (phase, table) in heavy {
            if let Some(panels) = phase.packed.matrix() {
                let rows = (&table.starts[..], &table.taps[..]);
                let product = self.product(panels, gradient, rows, epilogue);
                product.write_shared(target, &table.places);
            }
        }
        for_each_band(Threads::All, to, target, |band| {
            for (phase, table) in &light {
                let end = band.origin + band.target.len();
                let within = |limit: usize| table.places.partition_point(|&place| place < limit);
                let range = within(band.origin)..within(end);
                let rows = Rows {
                    source: gradient,
                    starts: &table.starts[range.clone()],
                    taps: &table.taps,
                    pitch: from.pitch,
                    places: &table.places[range],
                    origin: band.origin,
                };
                self.write(phase, &rows, band.target, epilogue);
            }
        });
    }

    /// A phase by fewer products, to maps of such a size, where that is worth it.
    fn winograd(&self, phase: &Phase<W>, size: Size) -> Option<Winograd> {
        let Packed::Matrices(groups) = &phase.packed else {
            return None;
        };
        if !Winograd::serves(size) {
            return None;
        }
        let ends = [self.shape.outputs, self.shape.inputs];
        Winograd::of(Threads::All, &self.shape.window, ends, groups, true)
    }

    /// The product for the rows of one group.
    fn product<'a>(
        &self,
        panels: &'a Panels<W>,
        source: &'a [W],
        (rows, taps): (&'a [usize], &'a [usize]),
        epilogue: Epilogue<'a>,
    ) -> Product<'a, W> {
        Product {
            source,
            rows,
            frame_rows: rows.len(),
            taps,
            run: W::words(self.shape.group_outputs()),
            lower: None,
            panels: panels.all(),
            epilogue,
        }
    }

    fn write(
        &self,
        phase: &Phase<W>,
        rows: &Rows<'_, W>,
        target: &mut [W],
        epilogue: Epilogue<'_>,
    ) {
        let Rows {
            source,
            starts,
            taps,
            pitch,
            places,
            origin,
        } = *rows;
        match &phase.packed {
            Packed::None => {
                for &place in places.iter().filter(|_| epilogue.accumulate.is_none()) {
                    target[place - origin..][..W::words(self.shape.inputs)].fill(W::default());
                }
            }
            Packed::Narrow(weights) => GroupedProduct {
                source,
                starts,
                taps,
                weights,
                epilogue,
            }
            .write(target, places, origin),
            Packed::Channels(weights) => DepthwiseProduct {
                source,
                starts,
                taps,
                pitch,
                stride: 1,
                columns: phase.columns(),
                weights,
                epilogue,
            }
            .write(target, places, origin),
            Packed::Matrices(groups) => {
                for (group, panels) in groups.iter().enumerate() {
                    let source = &source[W::words(group * self.shape.group_outputs())..];
                    let product = self.product(panels, source, (starts, taps), epilogue);
                    let column = group * self.shape.group_inputs();
                    product.write(&mut target[W::words(column)..], places, origin);
                }
            }
        }
    }
}

/// The rows of a product, and where they go.
struct Rows<'a, W> {
    source: &'a [W],
    starts: &'a [usize],
    taps: &'a [usize],
    /// Words from one pixel of the source to the next.
    pitch: usize,
    places: &'a [usize],
    origin: usize,
}

/// Where a phase reads and writes.
struct Table {
    starts: Vec<usize>,
    taps: Vec<usize>,
    places: Vec<usize>,
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
        let (taps, offsets): (Vec<usize>, Vec<_>) = places(window.size)
            .enumerate()
            .filter_map(|(index, tap)| Some((index, reaches(tap)?)))
            .unzip();
        Self {
            first,
            packed: Packed::pack(level, shape, &taps, weights),
            offsets,
        }
    }

    /// Pixels in a row of the part of the window.
    fn columns(&self) -> usize {
        let in_row = |offset: &&[isize; 3]| offset[..2] == self.offsets[0][..2];
        self.offsets.iter().take_while(in_row).count()
    }

    /// Pixels of the phase along each axis.
    fn count(&self, input: Size, stride: Size) -> Size {
        std::array::from_fn(|axis| {
            input[axis]
                .saturating_sub(self.first[axis])
                .div_ceil(stride[axis])
        })
    }

    fn table(&self, from: &Grid, to: &Grid, stride: Size) -> Table {
        let count = self.count(to.size, stride);
        let rows = 0..to.frames * count[0] * count[1];
        // From the border's corner; the offsets, which may be negative, lead back inside it.
        let starts = from.steps(rows.clone(), [0; 3], count, [1; 3]);
        let first = std::array::from_fn(|axis| to.before[axis] + self.first[axis]);
        let tap = |offset: &[isize; 3]| {
            let place = std::array::from_fn(|axis| {
                (from.before[axis] as isize + offset[axis]).max(0) as usize
            });
            from.index(0, place)
        };
        Table {
            starts,
            taps: self.offsets.iter().map(tap).collect(),
            places: to.steps(rows, first, count, stride),
        }
    }
}

impl<W: Real> Packed<W> {
    /// The matrix of the only group.
    fn matrix(&self) -> Option<&Panels<W>> {
        match self {
            Self::Matrices(groups) if groups.len() == 1 => groups.first(),
            _ => None,
        }
    }

    /// Those of the given taps, of weights as they are and as words.
    fn pack(
        level: Level,
        shape: &ConvShape,
        taps: &[usize],
        (weights, words): (&[f32], &[W]),
    ) -> Self {
        if taps.is_empty() {
            return Self::None;
        }
        let (inputs, outputs) = (shape.group_inputs(), shape.group_outputs());
        let all = pixels(shape.window.size);
        let numbers = W::each(words);
        let at = |output: usize, input: usize, tap: usize| {
            numbers[(output * inputs + input) * all + taps[tap]]
        };
        if shape.depthwise() {
            let element = |i: usize| weights[i / taps.len() * all + taps[i % taps.len()]];
            let some: Vec<f32> = (0..shape.inputs * taps.len()).map(element).collect();
            return Self::Channels(ChannelWeights::pack(level, taps.len(), &some));
        }
        if inputs == outputs && GroupWeights::<W>::serves(level, shape.inputs, inputs) {
            let element = |channel: usize, tap: usize, output: usize| {
                let (group, input) = (channel / inputs, channel % inputs);
                at(group * outputs + output, input, tap)
            };
            let (channels, taps) = (shape.inputs, taps.len());
            return Self::Narrow(GroupWeights::pack(level, channels, inputs, taps, element));
        }
        let group = |group: usize| {
            if all == 1 && W::NUMBERS == 1 {
                let matrix = &words[group * outputs * inputs..];
                return Panels::pack_rows(level, outputs, inputs, matrix);
            }
            let words = [taps.len(), W::words(outputs)];
            Panels::pack(level, words, inputs, |tap, word, input| {
                let output = group * outputs + W::NUMBERS * word;
                W::gathered(|i| at(output + i, input, tap))
            })
        };
        Self::Matrices((0..shape.groups).map(group).collect())
    }
}

/// Every place of a box, row by row.
fn places(size: Size) -> impl Iterator<Item = Size> {
    let [time, height, width] = size;
    (0..time * height * width).map(move |i| [i / (height * width), i / width % height, i % width])
}
