//! A network laid out for words of one kind, and its walk through the layers.

#[cfg(test)]
mod hard_cases;

use std::ops::Range;

use super::folded::{Ends, Folded, Packed};
use super::gate::PackedGate;
use super::scales::Scale;
use super::slots::Slots;
use crate::error::{Result, too_small};
use crate::images::{Images, lay_out};
use crate::network::{Conv, IMAGE, Layer, Map, MaxPool, Network};
use crate::ops::bands::Threads;
use crate::ops::buffer::Buffer;
use crate::ops::grid::{Grid, Size};
use crate::ops::image::Layout;
use crate::ops::pool::max_pool;
use crate::ops::product::{Columns, Epilogue};
use crate::ops::simd::Level;
use crate::ops::words::Word;
use crate::tensors::Tensors;

/// Frames of a pass: from the map [`Slots::meeting`] on they share each reading of a layer's weights; few
/// enough that their feature maps stay in the cache.
pub(super) const GROUP: usize = 4;

/// A network with its weights laid out for the kernels.
#[derive(Debug)]
pub(super) struct Fused<W> {
    /// The instructions that it runs by.
    pub(super) level: Level,
    /// Whether numbers of f32 are [split](crate::ops::split).
    split: bool,
    pub(super) network: Network,
    /// How images lie in memory.
    layout: Layout,
    steps: Vec<Step<W>>,
    slots: Slots,
    /// Of each map.
    scales: Vec<Scale>,
}

/// What makes a layer's map.
#[derive(Debug)]
enum Step<W> {
    /// Convolutions side by side.
    Convs(Vec<Part<W>>),
    Pool(MaxPool),
}

/// A convolution and the channel that it writes from.
#[derive(Debug)]
struct Part<W> {
    conv: Conv,
    packed: Packed<W>,
    /// Multiplies the results, at the end of a gated residual branch.
    gate: Option<PackedGate>,
    column: usize,
    /// The factor of what the map holds already, where results are added to that.
    accumulate: Option<f32>,
    limits: [f32; 2],
}

/// A feature map at one of the network's depths.
pub(super) struct Seen<'a, W> {
    /// Its place in embeddings.
    pub(super) block: Range<usize>,
    /// The first of the frames that it is of.
    pub(super) first: usize,
    pub(super) memory: &'a [W],
    pub(super) grid: &'a Grid,
    /// What its numbers stand for.
    pub(super) scale: Scale,
}

/// Memory of one thread's passes through the network.
#[derive(Debug, Default)]
pub(super) struct Workspace<W> {
    slots: Vec<Slot<W>>,
    /// The map [`Slots::meeting`] of all frames of a group.
    group: Buffer<W>,
}

/// Memory of maps, one after the other.
#[derive(Debug, Default)]
struct Slot<W> {
    memory: Buffer<W>,
    /// The layout whose border is filled, and its value; writing maps never touches it.
    border: Option<(Grid, f32)>,
}

impl<W: Word> Workspace<W> {
    /// Of memory.
    pub(super) fn bytes(&self) -> usize {
        let slots = self.slots.iter().map(|slot| slot.memory.bytes());
        slots.sum::<usize>() + self.group.bytes()
    }
}

impl<W: Word> Fused<W> {
    /// `scales`, one for each map, are for int8; `None` otherwise.
    pub(super) fn new(
        network: &Network,
        weights: &dyn Tensors,
        scales: Option<Vec<Scale>>,
        (level, split): (Level, bool),
    ) -> Result<Self> {
        let unit = || vec![Scale::UNIT; network.channels.len()];
        let mut fused = Self {
            level,
            split,
            network: network.clone(),
            layout: Layout::of::<W>(level, network.image_stride()),
            steps: Vec::new(),
            slots: Slots::new(network),
            scales: scales.unwrap_or_else(unit),
        };
        for (map, layer) in (1..).zip(&network.layers) {
            let step = fused.step(weights, layer, fused.scales[map])?;
            fused.steps.push(step);
        }
        Ok(fused)
    }

    /// What makes a layer's map, which is scaled like this.
    fn step(&self, weights: &dyn Tensors, layer: &Layer, to: Scale) -> Result<Step<W>> {
        if let Layer::MaxPool(pool) = layer {
            return Ok(Step::Pool(pool.clone()));
        }
        let (mut parts, mut column) = (Vec::new(), 0);
        for conv in layer.convs() {
            let ends = Ends {
                from: self.scales[conv.input],
                to,
                onto: layer.shortcut().map(|shortcut| self.scales[shortcut]),
            };
            let folded = Folded::new(conv, weights, self.network.eps)?;
            let gate = layer.gate();
            let gate = gate.map(|gate| PackedGate::new(gate, &folded, weights, self.level));
            let gate = gate.transpose()?;
            let mut packed = folded.pack((self.level, self.split), ends);
            // Behind a gate, the offset is added to what the gate makes of the shifts.
            if gate.is_none() {
                for shift in &mut packed.shift {
                    *shift += packed.offset;
                }
            }
            parts.push(Part {
                conv: conv.clone(),
                packed,
                gate,
                column,
                accumulate: ends.accumulate(),
                limits: ends.limits::<W>(conv.activation),
            });
            column += conv.outputs;
        }
        Ok(Step::Convs(parts))
    }

    /// Refuses images that are smaller than the network takes.
    pub(super) fn check(&self, images: &Images<'_>) -> Result<()> {
        let sizes = self.network.sizes(images.size);
        sizes.map(|_| ()).ok_or_else(|| too_small(images.size))
    }

    /// Multiply-adds of a layer for one frame, on average.
    pub(super) fn layer_multiply_adds(&self, size: Size) -> u64 {
        let all = self.network.multiply_adds(size).unwrap_or(u64::MAX);
        all / self.steps.len().max(1) as u64
    }

    /// Calls `see` with the map at each of the network's depths, of at most [`GROUP`] images
    /// `(frames, 3, ..size)`, as soon as it is made: the next layer may overwrite it.
    ///
    /// Maps that are large go through one frame at a time, which then stays in the cache.
    pub(super) fn walk(
        &self,
        threads: Threads,
        images: &Images<'_>,
        workspace: &mut Workspace<W>,
        mut see: impl FnMut(Seen<'_, W>),
    ) {
        let Workspace { slots, group } = workspace;
        slots.resize_with(self.slots.count, Slot::default);
        let frames = images.frames();
        let meeting = self.slots.meeting;
        let slot = self.slots.of[meeting];
        let one = self.grids(1, images.size);
        let mut show = |map: Map, first: usize, grids: &[Grid], slots: &[Slot<W>]| {
            if let Some(block) = self.network.block(map) {
                see(Seen {
                    block,
                    first,
                    memory: &slots[self.slots.of[map]].memory,
                    grid: &grids[map],
                    scale: self.scales[map],
                });
            }
        };
        for (frame, image) in images.iter().enumerate() {
            self.lay_out(threads, image, images, &one[IMAGE], slots);
            for number in 0..meeting {
                self.run(threads, number, &one, slots);
                show(number + 1, frame, &one, slots);
            }
            if frames > 1 && meeting < self.steps.len() {
                let len = one[meeting].len();
                group.resize(frames * len);
                group[frame * len..(frame + 1) * len].copy_from_slice(&slots[slot].memory);
            }
        }
        let grids = if frames > 1 && meeting < self.steps.len() {
            std::mem::swap(&mut slots[slot].memory, group);
            slots[slot].border = None;
            self.grids(frames, images.size)
        } else {
            one
        };
        for number in meeting..self.steps.len() {
            self.run(threads, number, &grids, slots);
            show(number + 1, 0, &grids, slots);
        }
    }

    /// Lays one of the images out in its slot.
    fn lay_out(
        &self,
        threads: Threads,
        image: &[f32],
        images: &Images<'_>,
        grid: &Grid,
        slots: &mut [Slot<W>],
    ) {
        let Slot { memory, border } = &mut slots[self.slots.of[IMAGE]];
        memory.resize(self.layout.memory::<W>(grid).len());
        *border = None;
        let (by, scale) = ((threads, self.level), self.scales[IMAGE]);
        lay_out(by, image, images, (memory, grid, self.layout), scale);
    }

    /// Makes room for a map, with a border of what stands for 0.
    fn pad(&self, map: Map, grid: &Grid, slot: &mut Slot<W>) {
        let zero = self.scales[map].zero;
        slot.memory.resize(grid.len());
        if slot.border != Some((*grid, zero)) {
            grid.fill_border(&mut slot.memory, W::of(|_| zero));
            slot.border = Some((*grid, zero));
        }
    }

    /// The layout of each map, with the border that its readers need. Maps that share memory share a layout.
    fn grids(&self, frames: usize, image: Size) -> Vec<Grid> {
        let (sizes, host) = (self.network.sizes(image), &self.slots.host);
        let sizes = sizes.unwrap_or_default();
        let grids = self.network.grids::<W>(frames, &sizes, |map| host[map]);
        (0..grids.len()).map(|map| grids[host[map]]).collect()
    }

    /// Makes the map of a layer.
    fn run(&self, threads: Threads, number: usize, grids: &[Grid], slots: &mut [Slot<W>]) {
        let map = number + 1;
        let (slot, to) = (self.slots.of[map], &grids[map]);
        let mut taken = std::mem::take(&mut slots[slot]);
        self.pad(map, to, &mut taken);
        let memory = &mut taken.memory;
        let source = |map: Map| (&slots[self.slots.of[map]].memory[..], &grids[map]);
        match &self.steps[number] {
            Step::Convs(parts) => {
                for part in parts {
                    let (source, from) = source(part.conv.input);
                    let target = (&mut memory[W::words(part.column)..], to);
                    let factors = part.gate.as_ref().map(|gate| {
                        let map = (source, from, self.scales[part.conv.input]);
                        gate.factors(threads, self.level, map, &part.packed)
                    });
                    part.apply(threads, (source, from), target, factors.as_ref());
                }
            }
            Step::Pool(pool) => {
                let (source, from) = source(pool.input);
                let window = pool.slide.window(from.size);
                max_pool(threads, self.level, &window, (source, from), (memory, to));
            }
        }
        slots[slot] = taken;
    }

    /// Calls `see` with every map of each of the images, one image at a time.
    pub(super) fn each_map(
        &self,
        threads: Threads,
        images: &Images<'_>,
        mut see: impl FnMut(Map, &[W], &Grid),
    ) {
        let mut slots: Vec<_> = (0..self.slots.count).map(|_| Slot::default()).collect();
        let grids = self.grids(1, images.size);
        for image in images.iter() {
            self.lay_out(threads, image, images, &grids[IMAGE], &mut slots);
            see(IMAGE, &slots[self.slots.of[IMAGE]].memory, &grids[IMAGE]);
            for number in 0..self.steps.len() {
                self.run(threads, number, &grids, &mut slots);
                let map = number + 1;
                see(map, &slots[self.slots.of[map]].memory, &grids[map]);
            }
        }
    }
}

impl<W: Word> Part<W> {
    /// Convolves, multiplies with factors and adds shifts, its own or those of a gate, and what is there if wanted.
    fn apply(
        &self,
        threads: Threads,
        source: (&[W], &Grid),
        target: (&mut [W], &Grid),
        gate: Option<&[Vec<f32>; 2]>,
    ) {
        let [scale, shift] = if let Some(gate) = gate {
            let channels = self.conv.outputs;
            gate.each_ref()
                .map(|values| Some(Columns::per_frame(values, channels)))
        } else {
            let scale = self.packed.scale.as_deref();
            [scale, Some(&self.packed.shift)].map(|values| values.map(Columns::shared))
        };
        let epilogue = Epilogue {
            scale,
            shift,
            accumulate: self.accumulate,
            limits: self.limits,
        };
        let window = self.conv.slide.window(source.1.size);
        let conv = &self.packed.conv;
        conv.apply_by(&window, threads, source, target, epilogue);
    }
}
