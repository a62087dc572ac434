//! A few layers, forward and backward.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use super::Value;
use super::conv::{KeptConv, biased_backward};
use super::layer::{Context, Gradients, Reverse};
use super::residual::KeptResidual;
use crate::error::Result;
use crate::network::{Conv, Layer, Map, MaxPool};
use crate::ops::bands::{Threads, for_each_band};
use crate::ops::buffer::Scratch;
use crate::ops::grid::Grid;
use crate::ops::pointwise::Shortcut;
use crate::ops::pool::{max_pool, max_pool_backward};
use crate::ops::product::Epilogue;
use crate::ops::words::Real;
use crate::training::BatchStatistics;

/// What the backward pass needs of a segment beside its input and output.
#[derive(Debug)]
pub(super) struct Kept<W: Real> {
    layers: Vec<KeptLayer<W>>,
    /// The maps from the input to the output. One that is deferred is not among them.
    values: BTreeMap<Map, Arc<Value<W>>>,
}

#[derive(Debug)]
enum KeptLayer<W: Real> {
    /// Convolutions side by side. Of one with a bias nothing is kept: its output is part of the map.
    Convs(Vec<Option<KeptConv<W>>>),
    Residual(Box<KeptResidual<W>>),
    Pool,
}

impl<W: Real> Kept<W> {
    /// Runs forward; returns what to keep, and the output.
    pub(super) fn record(
        context: &Context,
        layers: Range<usize>,
        input: &Arc<Value<W>>,
        grids: &[Grid],
        mut statistics: Option<&mut Vec<BatchStatistics>>,
    ) -> Result<(Self, Arc<Value<W>>)> {
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
    ) -> Result<(KeptLayer<W>, Option<Scratch<W>>)> {
        let memory = || {
            let mut memory = context.recycler.take(to.len());
            to.fill_borders(&mut memory, W::default());
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
                    let (onto, target) = (Some((&kept.factors[..], added)), (&mut memory[..], to));
                    let (norm, raw) = (&kept.conv.norm, kept.conv.raw.view());
                    norm.apply(context.level, raw, onto, target, conv.activation);
                }
                (KeptLayer::Residual(Box::new(kept)), Some(memory))
            }
            Layer::Conv(_) | Layer::Concat(_) => {
                let mut all = Vec::new();
                let mut memory = (!context.deferred(map)).then(memory);
                let mut column = 0;
                for conv in layer.convs() {
                    let source = &self.values[&conv.input];
                    let target = memory.as_mut();
                    let target = target.map(|memory| (&mut memory[W::words(column)..], to));
                    let statistics = statistics.as_deref_mut();
                    all.push(record(context, conv, source, target, statistics)?);
                    column += conv.outputs;
                }
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
        gradient: Scratch<W>,
        gradients: &mut Gradients,
    ) -> Result<Option<Scratch<W>>> {
        let mut pass = Reverse {
            context,
            of_maps: BTreeMap::from([(layers.end, gradient)]),
            gradients,
        };
        for (number, kept) in layers.clone().zip(&self.layers).rev() {
            let map = number + 1;
            let Some(gradient) = pass.of_maps.remove(&map) else {
                continue;
            };
            let layer = &context.network.layers[number];
            match (layer, kept) {
                (Layer::Residual { conv, shortcut, .. }, KeptLayer::Residual(kept)) => {
                    let ends = [conv.input, map].map(|map| self.values[&map].as_ref());
                    let branch = (conv, layer.gate());
                    let added = kept.backward(&mut pass, branch, ends, gradient)?;
                    give(&mut pass, *shortcut, added);
                }
                (Layer::MaxPool(pool), _) => {
                    let of_input = self.pooled(context, pool, &self.values[&map], &gradient);
                    give(&mut pass, pool.input, of_input);
                }
                (layer, KeptLayer::Convs(all)) => {
                    self.convs(&mut pass, map, (layer.convs(), all), &gradient)?;
                }
                _ => {}
            }
        }
        Ok(pass.of_maps.remove(&layers.start))
    }

    /// The map of a residual branch's shortcut, or its norm where it is deferred.
    fn shortcut(&self, map: Map) -> Option<Shortcut<'_, W>> {
        if let Some(value) = self.values.get(&map) {
            return Some(Shortcut::Plain(&value.memory, &value.grid));
        }
        let (first, _) = self.values.first_key_value()?;
        match self.layers.get(map.checked_sub(first + 1)?)? {
            KeptLayer::Convs(all) => {
                let kept = all.first()?.as_ref()?;
                Some(Shortcut::Normed(&kept.raw.memory, &kept.norm))
            }
            _ => None,
        }
    }

    /// Runs convolutions side by side backward, from the gradient of their map.
    fn convs(
        &self,
        pass: &mut Reverse<'_, W>,
        map: Map,
        (convs, all): (&[Conv], &[Option<KeptConv<W>>]),
        gradient: &[W],
    ) -> Result<()> {
        let channels = convs.iter().map(|conv| conv.outputs).sum();
        let mut column = 0;
        for (conv, kept) in convs.iter().zip(all) {
            let source = &self.values[&conv.input];
            if let (Some(kept), Some(norm)) = (kept, &conv.norm) {
                if let [_] = convs {
                    kept.backward(pass, (conv, norm), source, gradient)?;
                } else {
                    let part = columns(pass.context, gradient, (channels, column), &kept.raw.grid);
                    kept.backward(pass, (conv, norm), source, &part)?;
                }
            } else {
                let (output, grid) = self.values[&map].view();
                let first = W::words(column);
                let output = (&output[first..], grid);
                biased_backward(pass, conv, source, output, &gradient[first..])?;
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
        output: &Value<W>,
        gradient: &[W],
    ) -> Scratch<W> {
        let input = &self.values[&pool.input];
        let window = pool.slide.window(input.grid.size);
        let mut target = context.recycler.take::<W>(input.grid.len());
        let (level, from, to) = (context.level, input.view(), output.view());
        max_pool_backward(level, &window, from, to, gradient, &mut target);
        let bare = input.grid.bare();
        if bare == input.grid {
            return target;
        }
        let mut inside = context.recycler.take::<W>(bare.len());
        let len = bare.size[2] * bare.pitch;
        for_each_band(Threads::All, &bare, &mut inside, |band| {
            let rows = band.rows(&bare);
            for (row, out) in rows.zip(band.target.chunks_exact_mut(len)) {
                out.copy_from_slice(&target[input.grid.row_start(row)..][..len]);
            }
        });
        inside
    }
}

/// Runs a convolution forward, and writes its activated output into channels of its map, which the target begins with,
/// but where that is deferred; returns what to keep.
fn record<W: Real>(
    context: &Context,
    conv: &Conv,
    source: &Value<W>,
    target: Option<(&mut [W], &Grid)>,
    statistics: Option<&mut Vec<BatchStatistics>>,
) -> Result<Option<KeptConv<W>>> {
    if let Some(norm) = &conv.norm {
        let kept = KeptConv::record(context, (conv, norm), source, false, statistics)?;
        if let Some(target) = target {
            let (norm, raw) = (&kept.norm, kept.raw.view());
            norm.apply(context.level, raw, None, target, conv.activation);
        }
        return Ok(Some(kept));
    }
    if let Some(target) = target {
        context.parameter(&format!("{}.bias", conv.name), |bias| {
            let epilogue = Epilogue::biased(bias, conv.activation);
            context.convolve(conv, source.view(), target, epilogue)
        })??;
    }
    Ok(None)
}

/// Adds to the gradient of a map.
fn give<W: Real>(pass: &mut Reverse<'_, W>, map: Map, gradient: Scratch<W>) {
    let Some(sums) = pass.of_maps.get_mut(&map) else {
        pass.of_maps.insert(map, gradient);
        return;
    };
    for (sum, gradient) in W::each_mut(sums).iter_mut().zip(W::numbers(&gradient)) {
        *sum = W::narrowed(W::widened(*sum) + gradient);
    }
}

/// The part of a gradient from a column on, as `to` lies.
fn columns<W: Real>(
    context: &Context,
    gradient: &[W],
    (channels, column): (usize, usize),
    to: &Grid,
) -> Scratch<W> {
    let whole = Grid::tight(to.frames, to.size, channels).of::<W>();
    let whole = whole.staggered();
    let mut part = context.recycler.take::<W>(to.len());
    let pixels = part.chunks_exact_mut(to.pitch);
    for (pixel, whole) in pixels.zip(gradient.chunks_exact(whole.pitch)) {
        pixel[..to.words].copy_from_slice(&whole[W::words(column)..][..to.words]);
    }
    part
}
