//! Convolution of feature maps and images, channels last.

use std::sync::OnceLock;

use super::bands::{Threads, for_each_band};
use super::depthwise::{ChannelWeights, DepthwiseProduct};
use super::depthwise_bytes::{QuadProduct, QuadWeights};
use super::grid::{Grid, Size, Window, pixels};
use super::grouped::{GroupWeights, GroupedProduct};
use super::image::ImagePanels;
use super::panels::{PANEL_VECTORS, Panels};
use super::product::{Epilogue, Product};
use super::simd::Level;
use super::split::Split;
use super::winograd::{Reach, Winograd};
use super::words::{Word, lanes_of};

/// The shape of a convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConvShape {
    /// The window.
    pub window: Window,
    /// Channels that go in.
    pub inputs: usize,
    /// Channels that come out.
    pub outputs: usize,
    /// Parts that the channels are in, each convolved by itself.
    pub groups: usize,
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

    /// How many runs of memory a window on such a feature map has along each axis: with one group and no
    /// gap between pixels, a row of pixels is one run.
    pub(crate) fn runs(&self, from: &Grid) -> Size {
        let [time, height, width] = self.window.size;
        let joined = self.groups == 1 && from.pitch == from.words;
        [time, height, if joined { 1 } else { width }]
    }

    /// Whether each channel is a group of its own.
    pub(crate) const fn depthwise(&self) -> bool {
        self.groups > 1 && self.groups == self.inputs && self.groups == self.outputs
    }

    /// For matrix tiles, narrow groups joined to such as fill a panel, with weights of 0 between them, and those
    /// weights. None where there are no tiles or no such groups.
    pub(crate) fn joined<W: Word>(
        &self,
        level: Level,
        weights: &[f32],
    ) -> Option<(Self, Vec<f32>)> {
        let (inputs, outputs) = (self.group_inputs(), self.group_outputs());
        let wide = PANEL_VECTORS * level.lanes();
        let tiles = W::NUMBERS > 1 && level.tiles().is_some();
        let narrow = self.groups > 1 && !self.depthwise() && inputs == outputs && inputs < wide;
        let even = wide.is_multiple_of(inputs) && self.inputs.is_multiple_of(wide);
        if !(tiles && narrow && even) {
            return None;
        }
        let taps = pixels(self.window.size);
        let mut joined = vec![0.0; self.outputs * wide * taps];
        let rows = joined.chunks_exact_mut(wide * taps);
        for (output, (row, own)) in rows.zip(weights.chunks_exact(inputs * taps)).enumerate() {
            let first = output % wide / inputs * inputs;
            row[first * taps..][..own.len()].copy_from_slice(own);
        }
        let groups = self.inputs / wide;
        Some((Self { groups, ..*self }, joined))
    }

    /// Multiply-adds on a feature map of so many pixels; `None` where the window does not fit, or no
    /// number holds them.
    pub(crate) fn multiply_adds(&self, input: Size) -> Option<u64> {
        let taps = pixels(self.window.size) * self.group_inputs() * self.outputs;
        let mut places = self.window.output(input)?.into_iter();
        places.try_fold(taps as u64, |count, extent| {
            count.checked_mul(extent as u64)
        })
    }
}

/// A convolution with its weights laid out for the kernels.
#[derive(Debug, Clone)]
pub(crate) struct Conv<W = f32> {
    shape: ConvShape,
    weights: Weights<W>,
    /// For inference: the same in Winograd's form where that is worth it, laid out when a map is first
    /// large enough.
    winograd: Option<OnceLock<Option<Winograd>>>,
}

/// A convolution's weights.
#[derive(Debug, Clone)]
enum Weights<W> {
    Images(ImagePanels<W>),
    Maps(Packed<W>),
}

/// Those of a convolution of feature maps.
#[derive(Debug, Clone)]
enum Packed<W> {
    /// Each group as a matrix, by the rows of [`ConvShape::runs`].
    Matrices(Vec<Panels<W>>),
    /// Groups narrower than a vector.
    Narrow(GroupWeights<W>),
    /// Each channel by itself.
    Channels(ChannelWeights),
    /// Each channel by itself, in bytes.
    Quads(QuadWeights<W>),
    /// Of maps of f32, split in two of bf16.
    Split(Split),
}

impl<W: Word> Conv<W> {
    /// Packs weights `(outputs, inputs / groups, time, height, width)`, for feature maps of such
    /// words. The channels of a group fill whole words; where each channel is a group, only int8 needs
    /// that, of all channels together. For int8 the weights are whole numbers already.
    pub(crate) fn pack(level: Level, shape: ConvShape, weights: &[f32]) -> Self {
        if let Some((shape, weights)) = shape.joined::<W>(level, weights) {
            return Self::pack(level, shape, &weights);
        }
        let (inputs, outputs) = (shape.group_inputs(), shape.group_outputs());
        let taps = pixels(shape.window.size);
        if shape.depthwise() {
            let packed = if W::WHOLE {
                let columns = shape.window.size[2];
                let window = [taps / columns, columns];
                Packed::Quads(QuadWeights::pack(level, window, weights))
            } else {
                // Rounded to bf16, few weights that all but cancel each other would move sums too far.
                Packed::Channels(ChannelWeights::pack(level, taps, weights))
            };
            return Self::direct(shape, packed);
        }
        debug_assert!(inputs.is_multiple_of(W::NUMBERS), "{shape:?}");
        debug_assert!(outputs.is_multiple_of(W::NUMBERS), "{shape:?}");
        let words = W::of_weights(level, weights);
        let numbers = W::each(&words);
        let at =
            |out: usize, tap: usize, input: usize| numbers[(out * inputs + input) * taps + tap];
        let narrow = GroupWeights::<W>::serves(level, shape.outputs, outputs);
        let packed = if inputs == outputs && narrow {
            Packed::Narrow(GroupWeights::pack(level, shape.outputs, outputs, taps, at))
        } else {
            let group = |group: usize| {
                if taps == 1 {
                    let matrix = &words[W::words(group * outputs * inputs)..];
                    return Panels::pack_transposed(level, W::words(inputs), outputs, matrix);
                }
                let words = W::words(inputs);
                Panels::pack(level, [taps, words], outputs, |tap, word, column| {
                    let output = group * outputs + column;
                    W::gathered(|i| at(output, tap, W::NUMBERS * word + i))
                })
            };
            Packed::Matrices((0..shape.groups).map(group).collect())
        };
        Self::direct(shape, packed)
    }

    /// Packs weights `(outputs, 3, time, height, width)`, for images that lie as [`super::image`] says.
    pub(crate) fn pack_for_images(level: Level, shape: ConvShape, weights: &[f32]) -> Self {
        Self {
            shape,
            weights: Weights::Images(ImagePanels::pack(level, &shape, weights)),
            winograd: None,
        }
    }

    /// The same for inference: in Winograd's form, whose sums round more, where that is worth it.
    pub(crate) fn pack_for_inference(level: Level, shape: ConvShape, weights: &[f32]) -> Self {
        Self {
            winograd: Some(OnceLock::new()),
            ..Self::pack(level, shape, weights)
        }
    }

    /// The same for maps of f32 that are [split](super::split) where that is worth it.
    pub(crate) fn pack_split(level: Level, shape: ConvShape, weights: &[f32]) -> Self {
        match Split::pack(level, shape, weights) {
            Some(split) => Self::direct(shape, Packed::Split(split)),
            None => Self::pack_for_inference(level, shape, weights),
        }
    }

    /// Winograd's form, for maps of such a size.
    fn winograd(&self, size: Size) -> Option<&Winograd> {
        let laid_out = self.winograd.as_ref()?;
        let (shape, Weights::Maps(Packed::Matrices(groups))) = (&self.shape, &self.weights) else {
            return None;
        };
        if !Winograd::serves(size) {
            return None;
        }
        let ends = [shape.inputs, shape.outputs];
        // On one thread: while it waits, rayon could hand it a pass that waits for this cell, a deadlock.
        let lay_out = || Winograd::of(Threads::One, &shape.window, ends, groups, false);
        laid_out.get_or_init(lay_out).as_ref()
    }

    fn direct(shape: ConvShape, packed: Packed<W>) -> Self {
        Self {
            shape,
            weights: Weights::Maps(packed),
            winograd: None,
        }
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
        source: (&[W], &Grid),
        target: (&mut [W], &Grid),
        epilogue: Epilogue<'_>,
    ) {
        self.apply_by(&self.shape.window, threads, source, target, epilogue);
    }

    /// The same by a window of the same size with another padding.
    pub(crate) fn apply_by(
        &self,
        window: &Window,
        threads: Threads,
        source: (&[W], &Grid),
        target: (&mut [W], &Grid),
        epilogue: Epilogue<'_>,
    ) {
        debug_assert_eq!(window.size, self.shape.window.size);
        debug_assert_eq!(window.output(source.1.size), Some(target.1.size));
        match &self.weights {
            Weights::Images(panels) => panels.apply(window, threads, source, target, epilogue),
            Weights::Maps(packed) => {
                self.apply_packed(packed, window, threads, source, target, epilogue);
            }
        }
    }

    fn apply_packed(
        &self,
        packed: &Packed<W>,
        window: &Window,
        threads: Threads,
        (source, from): (&[W], &Grid),
        (target, to): (&mut [W], &Grid),
        epilogue: Epilogue<'_>,
    ) {
        if let Packed::Split(split) = packed {
            let target = bytemuck::cast_slice_mut(target);
            return split.apply(
                window,
                threads,
                (lanes_of(source), from),
                (target, to),
                epilogue,
            );
        }
        let reach = || (from.starts(window, to.size), to.places());
        if let Some(winograd) = self.winograd(to.size) {
            debug_assert_eq!(window.stride, self.shape.window.stride);
            let (starts, places) = reach();
            let reach = Reach {
                source,
                from,
                starts: &starts,
                to,
                places: &places,
            };
            winograd.apply(threads, reach, target, epilogue);
            return;
        }
        let taps = self.taps(from);
        if let (Threads::All, Packed::Matrices(groups)) = (threads, packed)
            && let [panels] = &groups[..]
            && panels.outweigh(from, to)
        {
            let (starts, places) = reach();
            let product = Product {
                source,
                rows: &starts,
                frame_rows: pixels(to.size),
                taps: &taps,
                run: panels.k() / taps.len(),
                lower: None,
                panels: panels.all(),
                epilogue,
            };
            product.write_shared(target, &places);
            return;
        }
        for_each_band(threads, to, target, |band| {
            let rows = band.rows(to);
            let starts = &from.starts_of(rows.clone(), window, to.size)[..];
            let places = &to.places_of(rows)[..];
            match packed {
                Packed::Split(_) => (),
                Packed::Narrow(weights) => GroupedProduct {
                    source,
                    starts,
                    taps: &taps,
                    weights,
                    epilogue,
                }
                .write(band.target, places, band.origin),
                Packed::Channels(weights) => DepthwiseProduct {
                    source,
                    starts,
                    taps: &taps,
                    pitch: from.pitch,
                    stride: window.stride[2],
                    columns: window.size[2],
                    weights,
                    epilogue,
                }
                .write(band.target, places, band.origin),
                Packed::Quads(weights) => QuadProduct {
                    source,
                    starts,
                    taps: &taps,
                    pitch: from.pitch,
                    stride: window.stride[2],
                    weights,
                    epilogue,
                }
                .write(band.target, places, band.origin),
                Packed::Matrices(groups) => {
                    for (group, panels) in groups.iter().enumerate() {
                        let column = group * self.shape.group_outputs();
                        let product = Product {
                            source: &source[W::words(group * self.shape.group_inputs())..],
                            rows: starts,
                            frame_rows: places.len() / band.frames.len().max(1),
                            taps: &taps,
                            run: panels.k() / taps.len(),
                            lower: None,
                            panels: panels.all(),
                            epilogue: epilogue.from(band.frames.start, column),
                        };
                        let target = &mut band.target[W::words(column)..];
                        product.write(target, places, band.origin);
                    }
                }
            }
        });
    }

    /// The beginnings of a window's runs, from its own beginning.
    fn taps(&self, from: &Grid) -> Vec<usize> {
        from.taps(self.shape.runs(from))
    }
}
