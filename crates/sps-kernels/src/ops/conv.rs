//! Convolution of feature maps and images, channels last.

use std::sync::OnceLock;

use super::bands::Threads;
use super::grid::{Grid, Size, Window, pixels};
use super::image::{self, Layout, Phase as ImagePhase, rows_of_words};
use super::panels::PANEL_VECTORS;
use super::phases::{Lattice, Packed, Phase, convolve};
use super::product::Epilogue;
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
    pub(crate) const fn group_inputs(&self) -> usize {
        self.inputs / self.groups
    }

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

    /// Multiply-adds on a map of so many pixels; `None` where the window does not fit, or no number holds them.
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
    /// For inference: the same in Winograd's form where that is worth it, laid out for the first large map.
    winograd: Option<OnceLock<Option<Winograd>>>,
}

/// A convolution's weights.
#[derive(Debug, Clone)]
enum Weights<W> {
    Images(Vec<(ImagePhase, Packed<W>)>),
    /// Of images in cells.
    Cells(ConvShape, Packed<W>),
    Maps(Packed<W>),
    /// Of images or maps of f32, split in two of bf16.
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
        Self {
            shape,
            weights: Weights::Maps(pack_for_maps(level, &shape, weights)),
            winograd: None,
        }
    }

    /// Packs weights `(outputs, 3, time, height, width)`, for images that lie as [`Layout::of`] says.
    pub(crate) fn pack_for_images(level: Level, shape: ConvShape, weights: &[f32]) -> Self {
        let weights = match Layout::of::<W>(level, shape.window.stride) {
            Layout::Rows => Weights::Images(image::pack(level, &shape, weights)),
            Layout::Cells => {
                let (cells, weights) = image::of_cells(&shape, weights);
                Weights::Cells(cells, pack_for_maps(level, &cells, &weights))
            }
        };
        Self {
            shape,
            weights,
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
        let split = Split::pack(level, shape, weights);
        Self::of_split(split, || Self::pack_for_inference(level, shape, weights))
    }

    /// The same for images.
    pub(crate) fn pack_split_for_images(level: Level, shape: ConvShape, weights: &[f32]) -> Self {
        let split = Split::pack_for_images(level, shape, weights);
        Self::of_split(split, || Self::pack_for_images(level, shape, weights))
    }

    fn of_split(split: Option<Split>, unsplit: impl FnOnce() -> Self) -> Self {
        split.map_or_else(unsplit, |split| Self {
            shape: split.shape,
            weights: Weights::Split(split),
            winograd: None,
        })
    }

    /// Winograd's form, for maps of such a size.
    fn winograd(&self, size: Size) -> Option<&Winograd> {
        let laid_out = self.winograd.as_ref()?;
        let (shape, Weights::Maps(packed)) = (&self.shape, &self.weights) else {
            return None;
        };
        let matrix = packed.matrix().filter(|_| Winograd::serves(size))?;
        let ends = [shape.inputs, shape.outputs];
        // On one thread: while it waits, rayon could hand it a pass that waits for this cell, a deadlock.
        let lay_out = || Winograd::of(Threads::One, &shape.window, ends, matrix, false);
        laid_out.get_or_init(lay_out).as_ref()
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
        (source, from): (&[W], &Grid),
        (target, to): (&mut [W], &Grid),
        epilogue: Epilogue<'_>,
    ) {
        debug_assert_eq!(window.size, self.shape.window.size);
        debug_assert_eq!(window.output(from.size), Some(to.size));
        if let Some(winograd) = self.winograd(to.size) {
            debug_assert_eq!(window.stride, self.shape.window.stride);
            let reach = Lattice::of_window(window, from).whole_reach(from, to);
            let reach = Reach {
                source,
                from,
                starts: &reach.starts,
                to,
                places: &reach.places,
            };
            winograd.apply(threads, reach, target, epilogue);
            return;
        }
        match &self.weights {
            Weights::Images(phases) => {
                let taps = image::taps::<W>(window, from);
                let phases = phases.iter().map(|(phase, packed)| Phase {
                    lattice: phase.lattice(window, from),
                    taps: taps.clone(),
                    packed,
                });
                let rows = rows_of_words::<W>(from);
                let phases: Vec<_> = phases.collect();
                convolve(&phases, threads, (source, &rows), (target, to), epilogue);
            }
            Weights::Cells(shape, packed) => {
                let from = Layout::Cells.memory::<W>(from);
                let window = image::cell_window(window);
                let phase = of_map(shape, &window, &from, packed);
                convolve(&[phase], threads, (source, &from), (target, to), epilogue);
            }
            Weights::Maps(packed) => {
                let phase = of_map(&self.shape, window, from, packed);
                convolve(&[phase], threads, (source, from), (target, to), epilogue);
            }
            Weights::Split(split) => {
                let source = (lanes_of(source), from);
                let target = (bytemuck::cast_slice_mut(target), to);
                split.apply(window, threads, source, target, epilogue);
            }
        }
    }
}

fn pack_for_maps<W: Word>(level: Level, shape: &ConvShape, weights: &[f32]) -> Packed<W> {
    let taps: Vec<usize> = (0..pixels(shape.window.size)).collect();
    let words = W::of_weights(level, weights);
    Packed::pack(level, shape, &taps, (weights, &words), false)
}

/// The only phase of a convolution of a map.
fn of_map<'a, W: Word>(
    shape: &ConvShape,
    window: &Window,
    from: &Grid,
    packed: &'a Packed<W>,
) -> Phase<'a, W> {
    Phase {
        lattice: Lattice::of_window(window, from),
        taps: from.taps(shape.runs(from)),
        packed,
    }
}
