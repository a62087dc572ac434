//! A few layers, forward and backward.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::ops::Range;
use std::sync::Arc;

use super::Value;
use super::conv::KeptConv;
use super::layer::{Context, Gradients};
use super::residual::KeptResidual;
use crate::encoders::network::{Conv, Layer, Map, MaxPool};
use crate::encoders::plain::BatchStatistics;
use crate::error::Result;
use crate::ops::bands::Threads;
use crate::ops::buffer::Scratch;
use crate::ops::grid::Grid;
use crate::ops::pool::{max_pool, max_pool_backward};
use crate::ops::residual::Shortcut;

/// What the backward pass needs of a segment beside its input and output.
#[derive(Debug)]
pub(super) struct Kept {
    layers: Vec<KeptLayer>,
    /// The maps from the input to the output. One that is deferred is not among them.
    values: BTreeMap<Map, Arc<Value>>,
}

#[derive(Debug)]
enum KeptLayer {
    Convs(Vec<KeptConv>),
    Residual(Box<KeptResidual>),
    Pool,
}

/// The gradients of maps, without borders, as far as they are known.
pub(super) type MapGradients = BTreeMap<Map, Scratch>;

impl Kept {
    /// Runs forward; returns what to keep, and the output.
    pub(super) fn record(
        context: &Context,
        layers: Range<usize>,
        input: &Arc<Value>,
        grids: &[Grid],
        mut statistics: Option<&mut Vec<BatchStatistics>>,
    ) -> Result<(Self, Arc<Value>)> {
        let mut kept = Self {
            layers: Vec::new(),
            values: BTreeMap::from([(layers.start, Arc::clone(input))]),
        };
        let mut output = Arc::clone(input);
        for number in layers {
            let (map, grid) = (number + 1, grids[number + 1]);
            let layer = &context.network.layers[number];
            let statistics = statistics.as_deref_mut();
            let (layer, memory) = kept.layer(context, (map, layer), &grid, statistics)?;
            kept.layers.push(layer);
            if let Some(memory) = memory {
                output = Arc::new(Value { memory, grid });
                kept.values.insert(map, Arc::clone(&output));
            }
        }
        Ok((kept, output))
    }

    /// Runs one layer forward; returns what to keep of it, and its map but where that is deferred.
    fn layer(
        &self,
        context: &Context,
        (map, layer): (Map, &Layer),
        to: &Grid,
        mut statistics: Option<&mut Vec<BatchStatistics>>,
    ) -> Result<(KeptLayer, Option<Scratch>)> {
        let memory = || {
            let mut memory = context.recycler.take(to.len());
            to.fill_border(&mut memory, 0.0);
            memory
        };
        Ok(match layer {
            Layer::MaxPool(pool) => {
                let (mut memory, source) = (memory(), &self.values[&pool.input]);
                let window = pool.slide.window(source.grid.size);
                let target = (&mut memory[..], to);
                max_pool(Threads::All, context.level, &window, source.view(), target);
                (KeptLayer::Pool, Some(memory))
            }
            Layer::Residual {
                conv,
                gate,
                shortcut,
            } => {
                let source = &self.values[&conv.input];
                let kept = KeptResidual::record(context, conv, gate.as_ref(), source, statistics)?;
                let mut memory = memory();
                if let Some(added) = self.shortcut(*shortcut) {
                    kept.end(context, conv, added, (&mut memory, to));
                }
                (KeptLayer::Residual(Box::new(kept)), Some(memory))
            }
            Layer::Conv(_) | Layer::Concat(_) => {
                let mut all = Vec::new();
                for conv in layer.convs() {
                    let source = &self.values[&conv.input];
                    let statistics = statistics.as_deref_mut();
                    all.push(KeptConv::record(context, conv, source, statistics)?);
                }
                let memory = (!context.deferred(map)).then(|| {
                    let mut memory = memory();
                    activate(context, layer.convs(), &all, (&mut memory, to));
                    memory
                });
                (KeptLayer::Convs(all), memory)
            }
        })
    }

    /// Runs backward: from the gradient of the output to that of the input, but where that is the
    /// image.
    pub(super) fn backward(
        &self,
        context: &Context,
        layers: &Range<usize>,
        gradient: Scratch,
        gradients: &mut Gradients,
    ) -> Result<Option<Scratch>> {
        let mut of_maps = MapGradients::from([(layers.end, gradient)]);
        for (number, kept) in layers.clone().zip(&self.layers).rev() {
            let map = number + 1;
            let Some(gradient) = of_maps.remove(&map) else {
                continue;
            };
            let layer = &context.network.layers[number];
            match (layer, kept) {
                (
                    Layer::Residual {
                        conv,
                        gate,
                        shortcut,
                    },
                    KeptLayer::Residual(kept),
                ) => {
                    let ends = [&self.values[&conv.input], &self.values[&map]];
                    let pass = (context, conv, gate.as_ref());
                    let added = kept.backward(
                        pass,
                        ends.map(Arc::as_ref),
                        gradient,
                        &mut of_maps,
                        gradients,
                    )?;
                    give(&mut of_maps, *shortcut, added);
                }
                (Layer::MaxPool(pool), _) => {
                    let of_input = self.pooled(context, pool, &self.values[&map], &gradient);
                    give(&mut of_maps, pool.input, of_input);
                }
                (layer, KeptLayer::Convs(all)) => {
                    let convs = (layer.convs(), &all[..]);
                    self.convs(context, convs, &gradient, &mut of_maps, gradients)?;
                }
                _ => {}
            }
        }
        Ok(of_maps.remove(&layers.start))
    }

    /// The map of a residual branch's shortcut, or its norm where it is deferred.
    fn shortcut(&self, map: Map) -> Option<Shortcut<'_>> {
        if let Some(value) = self.values.get(&map) {
            return Some(Shortcut::Plain(&value.memory, &value.grid));
        }
        let (first, _) = self.values.first_key_value()?;
        match self.layers.get(map.checked_sub(first + 1)?)? {
            KeptLayer::Convs(all) => all.first().map(|c| Shortcut::Normed(&c.raw, &c.norm)),
            _ => None,
        }
    }

    /// Runs convolutions side by side backward.
    fn convs(
        &self,
        context: &Context,
        (convs, all): (&[Conv], &[KeptConv]),
        gradient: &[f32],
        of_maps: &mut MapGradients,
        gradients: &mut Gradients,
    ) -> Result<()> {
        let channels = convs.iter().map(|conv| conv.outputs).sum();
        let mut column = 0;
        for (conv, kept) in convs.iter().zip(all) {
            let source = &self.values[&conv.input];
            let pass = (context, conv);
            if let [_] = convs {
                kept.backward(pass, source, gradient, of_maps, gradients)?;
            } else {
                let part = columns(context, gradient, (channels, column), &kept.grid);
                kept.backward(pass, source, &part, of_maps, gradients)?;
            }
            column += conv.outputs;
        }
        Ok(())
    }

    /// The gradient of a pooled map.
    fn pooled(
        &self,
        context: &Context,
        pool: &MaxPool,
        output: &Value,
        gradient: &[f32],
    ) -> Scratch {
        let input = &self.values[&pool.input];
        let window = pool.slide.window(input.grid.size);
        let mut target = context.recycler.take(input.grid.len());
        let level = context.level;
        max_pool_backward(
            level,
            &window,
            input.view(),
            output.view(),
            gradient,
            &mut target,
        );
        let bare = input.grid.bare();
        if bare == input.grid {
            return target;
        }
        let mut inside = context.recycler.take(bare.len());
        let pixels = inside.chunks_exact_mut(bare.pitch);
        for (pixel, place) in pixels.zip(input.grid.places()) {
            pixel.copy_from_slice(&target[place..place + bare.pitch]);
        }
        inside
    }
}

/// Adds to the gradient of a map.
fn give(of_maps: &mut MapGradients, map: Map, gradient: Scratch) {
    match of_maps.entry(map) {
        Entry::Vacant(entry) => {
            entry.insert(gradient);
        }
        Entry::Occupied(mut entry) => {
            for (sum, gradient) in entry.get_mut().iter_mut().zip(&gradient[..]) {
                *sum += gradient;
            }
        }
    }
}

/// The part of a gradient from a column on, as `to` lies.
fn columns(
    context: &Context,
    gradient: &[f32],
    (channels, column): (usize, usize),
    to: &Grid,
) -> Scratch {
    let whole = Grid::tight(to.frames, to.size, channels).staggered();
    let mut part = context.recycler.take(to.len());
    let pixels = part.chunks_exact_mut(to.pitch);
    for (pixel, whole) in pixels.zip(gradient.chunks_exact(whole.pitch)) {
        pixel[..to.channels].copy_from_slice(&whole[column..column + to.channels]);
    }
    part
}

/// Writes activated norms side by side into a map.
fn activate(
    context: &Context,
    convs: &[Conv],
    all: &[KeptConv],
    (memory, to): (&mut [f32], &Grid),
) {
    let mut column = 0;
    for (conv, kept) in convs.iter().zip(all) {
        kept.activate(context, conv.activation, (&mut memory[column..], to));
        column += conv.outputs;
    }
}
