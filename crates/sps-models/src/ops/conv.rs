//! Convolution of feature maps, channels last.

use super::bands::{Threads, for_each_band};
use super::format::{Format, pair};
use super::grid::{Grid, Size, Window, pixels};
use super::grouped::{GroupWeights, GroupedProduct};
use super::panels::Panels;
use super::product::{Epilogue, Product};
use super::simd::Level;

/// The shape of a convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ConvShape {
    pub(crate) window: Window,
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
    pub(crate) groups: usize,
}

impl ConvShape {
    /// Channels of a group that go in.
    pub(crate) const fn group_inputs(&self) -> usize {
        self.inputs / self.groups
    }

    /// Channels of a group that come out.
    pub(crate) const fn group_outputs(&self) -> usize {
        self.outputs / self.groups
    }

    /// Multiply-adds on a feature map of so many pixels; `None` where the window does not fit.
    pub(crate) fn multiply_adds(&self, input: Size) -> Option<u64> {
        let places = pixels(self.window.output(input)?);
        let taps = pixels(self.window.size) * self.group_inputs() * self.outputs;
        Some((places * taps) as u64)
    }
}

/// A convolution with its weights laid out for the kernels.
#[derive(Debug, Clone)]
pub(crate) struct Conv {
    shape: ConvShape,
    format: Format,
    weights: Weights,
}

#[derive(Debug, Clone)]
enum Weights {
    /// Each group as a matrix. Where there is one group, a run of the source spans a row of the
    /// window, else a pixel.
    Matrices(Vec<Panels>),
    /// Groups narrower than a vector.
    Narrow(GroupWeights),
}

impl Conv {
    /// Packs weights `(outputs, inputs / groups, time, height, width)`, for feature maps of f32.
    pub(crate) fn pack(level: Level, shape: ConvShape, weights: &[f32]) -> Self {
        Self::pack_as(level, Format::F32, shape, weights)
    }

    /// Packs weights `(outputs, inputs / groups, time, height, width)`, for feature maps of a
    /// format.
    ///
    /// With [`Format::Bf16`] a group has an even number of inputs and of outputs.
    pub(crate) fn pack_as(level: Level, format: Format, shape: ConvShape, weights: &[f32]) -> Self {
        let (inputs, outputs) = (shape.group_inputs(), shape.group_outputs());
        debug_assert!(inputs.is_multiple_of(format.numbers()), "{shape:?}");
        debug_assert!(outputs.is_multiple_of(format.numbers()), "{shape:?}");
        let taps = pixels(shape.window.size);
        let at =
            |out: usize, tap: usize, input: usize| weights[(out * inputs + input) * taps + tap];
        let narrow =
            inputs == outputs && GroupWeights::serves(level, format, shape.outputs, outputs);
        let weights = if narrow {
            let packed = GroupWeights::pack(level, format, shape.outputs, outputs, taps, at);
            Weights::Narrow(packed)
        } else {
            let group = |group: usize| {
                if taps == 1 && format == Format::F32 {
                    let matrix = &weights[group * outputs * inputs..][..outputs * inputs];
                    return Panels::pack_transposed(level, inputs, outputs, matrix);
                }
                let number = |row: usize, column: usize| {
                    at(group * outputs + column, row / inputs, row % inputs)
                };
                let word = |row: usize, column: usize| match format {
                    Format::F32 => number(row, column),
                    Format::Bf16 => pair(number(2 * row, column), number(2 * row + 1, column)),
                };
                let rows = format.words(taps * inputs);
                Panels::pack(level, rows, outputs, word).in_format(format)
            };
            Weights::Matrices((0..shape.groups).map(group).collect())
        };
        Self {
            shape,
            format,
            weights,
        }
    }

    /// The format of the feature maps that go in and come out.
    pub(crate) fn format(&self) -> Format {
        self.format
    }

    /// The convolution's shape.
    pub(crate) fn shape(&self) -> &ConvShape {
        &self.shape
    }

    /// Convolves `source`, which lies in memory as `from` says, into `target`, as `to` says.
    ///
    /// `from` has at least the window's padding as a border of zeros.
    pub(crate) fn apply(
        &self,
        threads: Threads,
        (source, from): (&[f32], &Grid),
        (target, to): (&mut [f32], &Grid),
        epilogue: Epilogue<'_>,
    ) {
        debug_assert_eq!((from.format, to.format), (self.format, self.format));
        debug_assert_eq!(
            self.shape.window.output(from.size),
            Some(to.size),
            "{self:?}"
        );
        let starts = from.starts(&self.shape.window, to.size);
        let places = to.places();
        let taps = self.taps(from);
        for_each_band(threads, to, target, |band| {
            let starts = &starts[band.pixels.clone()];
            let places = &places[band.pixels];
            match &self.weights {
                Weights::Narrow(weights) => GroupedProduct {
                    source,
                    starts,
                    taps: &taps,
                    weights,
                    epilogue,
                }
                .write(band.target, places, band.origin),
                Weights::Matrices(groups) => {
                    for (group, panels) in groups.iter().enumerate() {
                        let column = group * self.shape.group_outputs();
                        let product = Product {
                            source: &source[self.format.words(group * self.shape.group_inputs())..],
                            rows: starts,
                            frame_rows: places.len() / band.frames.len().max(1),
                            taps: &taps,
                            run: panels.k() / taps.len(),
                            panels,
                            epilogue: epilogue.from(band.frames.start, column),
                        };
                        let target = &mut band.target[self.format.words(column)..];
                        product.write(target, places, band.origin);
                    }
                }
            }
        });
    }

    /// The beginnings of a window's runs, from its own beginning.
    fn taps(&self, from: &Grid) -> Vec<u32> {
        let [time, height, width] = self.shape.window.size;
        if self.shape.groups == 1 {
            from.taps([time, height, 1])
        } else {
            from.taps([time, height, width])
        }
    }
}
