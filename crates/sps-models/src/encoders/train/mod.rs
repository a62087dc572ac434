//! A network in training, on the CPU kernels: a forward pass that keeps what the backward pass
//! needs, and the backward pass.
//!
//! A feature map is kept where a gradient needs it and nowhere else: each convolution's output
//! before its batch norm, and its activated norm where it feeds another layer.

mod conv;
mod gate;
mod layer;
mod residual;
mod segment;

use std::ops::Range;
use std::sync::Arc;

use super::batch::Images;
use super::images::lay_out;
use super::network::{IMAGE, Map, Network};
use super::plain::BatchStatistics;
use crate::error::Result;
use crate::ops::bands::Threads;
use crate::ops::buffer::Scratch;
use crate::ops::grid::{Grid, pixels};
use crate::ops::image::rows_of_words;
use crate::ops::mean::frame_means;
use crate::ops::words::Real;
pub(super) use layer::{Context, Gradients};
use segment::Kept;

/// A feature map with the padding that its readers need around it.
#[derive(Debug)]
struct Value<W: Real> {
    memory: Scratch<W>,
    grid: Grid,
}

impl<W: Real> Value<W> {
    /// Memory and layout.
    fn view(&self) -> (&[W], &Grid) {
        (&self.memory, &self.grid)
    }
}

/// A forward pass, kept for its backward pass; feature maps and their gradients are of such words.
#[derive(Debug)]
pub(super) struct Tape<W: Real> {
    segments: Vec<Segment<W>>,
    /// The layout of each map.
    grids: Vec<Grid>,
}

/// Layers that read nothing made before them but one map.
#[derive(Debug)]
struct Segment<W: Real> {
    layers: Range<usize>,
    input: Arc<Value<W>>,
    /// What else the backward pass needs; made again from the input where it was not kept.
    kept: Option<Kept<W>>,
}

impl<W: Real> Tape<W> {
    /// Runs forward; returns the embeddings, `(frames, width)`, too. With `checkpointing`, only the
    /// inputs of the segments are kept, and the backward pass runs each segment forward once more.
    pub(super) fn record(
        context: &Context,
        images: &Images<'_>,
        checkpointing: bool,
        statistics: &mut Vec<BatchStatistics>,
    ) -> Result<(Self, Vec<f32>)> {
        let grids = context.grids::<W>(images.frames(), images.size)?;
        let mut input = Arc::new(images_value(context, images, grids[IMAGE]));
        let mut segments = Vec::new();
        let width = context.network.width();
        let mut embeddings = vec![0.0; images.frames() * width];
        for layers in ranges(&context.network) {
            let end = layers.end;
            let (kept, output) =
                Kept::record(context, layers.clone(), &input, &grids, Some(statistics))?;
            segments.push(Segment {
                layers,
                input,
                kept: (!checkpointing).then_some(kept),
            });
            if let Some(block) = context.network.block(end) {
                let (map, grid) = output.view();
                let frames = embeddings.chunks_exact_mut(width);
                let mut means: Vec<_> = frames.map(|frame| &mut frame[block.clone()]).collect();
                frame_means(Threads::All, context.level, map, grid, &mut means);
            }
            input = output;
        }
        Ok((Self { segments, grids }, embeddings))
    }

    /// The gradients of the parameters, from that of the embeddings.
    pub(super) fn backward(&self, context: &Context, cotangent: &[f32]) -> Result<Gradients> {
        let mut gradients = Gradients::default();
        let mut next = None;
        for segment in self.segments.iter().rev() {
            let map = segment.layers.end;
            if let Some(block) = context.network.block(map) {
                let cotangents = cotangent.chunks_exact(context.network.width());
                let cotangents = cotangents.map(|frame| &frame[block.clone()]);
                let grid = self.grids[map].bare();
                let gradient = next.get_or_insert_with(|| {
                    let mut nothing = context.recycler.take::<W>(grid.len());
                    nothing.fill(W::default());
                    nothing
                });
                add_of_mean(&grid, cotangents, gradient);
            }
            let Some(gradient) = next else {
                break;
            };
            let again;
            let kept = if let Some(kept) = &segment.kept {
                kept
            } else {
                let layers = segment.layers.clone();
                again = Kept::record(context, layers, &segment.input, &self.grids, None)?.0;
                &again
            };
            next = kept.backward(context, &segment.layers, gradient, &mut gradients)?;
        }
        Ok(gradients)
    }
}

/// Adds to the gradient of a map, which lies without a border, that of its mean over space.
fn add_of_mean<'a, W: Real>(
    grid: &Grid,
    cotangents: impl Iterator<Item = &'a [f32]>,
    gradient: &mut [W],
) {
    let share = 1.0 / pixels(grid.size) as f32;
    let frames = gradient.chunks_exact_mut(grid.frame_len());
    for (frame, cotangent) in frames.zip(cotangents) {
        for pixel in frame.chunks_exact_mut(grid.pitch) {
            for (gradient, cotangent) in W::each_mut(pixel).iter_mut().zip(cotangent) {
                *gradient = W::narrowed(W::widened(*gradient) + cotangent * share);
            }
        }
    }
}

/// The images, normalised.
fn images_value<W: Real>(context: &Context, images: &Images<'_>, grid: Grid) -> Value<W> {
    let rows = rows_of_words::<W>(&grid);
    let mut memory = context.recycler.take(rows.len());
    let one = Grid { frames: 1, ..grid };
    let frames = memory.chunks_exact_mut(rows.frame_len());
    for (image, memory) in images.iter().zip(frames) {
        lay_out(Threads::All, image, images, (memory, &one), 0.0);
    }
    Value { memory, grid }
}

/// The layers cut at each map that is alone: all made before it have been read.
fn ranges(network: &Network) -> Vec<Range<usize>> {
    let last_readers = network.last_readers();
    let alone = |map: Map| last_readers[..map].iter().all(|&last| last < map);
    let mut ranges = Vec::new();
    let mut start = 0;
    for end in (1..=network.layers.len()).filter(|&map| alone(map)) {
        ranges.push(start..end);
        start = end;
    }
    ranges
}
