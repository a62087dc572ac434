//! The network in training, on the CPU kernels: a forward pass that keeps what the backward pass
//! needs, and the backward pass.
//!
//! A feature map is kept where a gradient needs it and nowhere else: each convolution's output
//! before its batch norm, and its rectified norm where it feeds the next convolution.

mod bottleneck;
mod gate;
mod layer;

use std::sync::Arc;

use crate::encoders::batch::Images;
use crate::encoders::images::lay_out;
use crate::error::Result;
use crate::ops::bands::Threads;
use crate::ops::batch_norm::{Norm, NormGradients};
use crate::ops::buffer::Scratch;
use crate::ops::conv::ConvShape;
use crate::ops::grid::{Grid, pixels};
use crate::ops::pool::{max_pool, max_pool_backward};

use super::{POOL, STEM, SeResNextConfig};
use crate::encoders::plain::BatchStatistics;
use bottleneck::Kept;
pub(in crate::encoders) use layer::{Context, Gradients};

/// A forward pass, kept for its backward pass.
#[derive(Debug)]
pub(in crate::encoders) struct Tape {
    config: SeResNextConfig,
    stem: Stem,
    bottlenecks: Vec<Link>,
    last: Arc<Scratch>,
    grid: Grid,
}

/// The stem's part of the tape.
#[derive(Debug)]
struct Stem {
    images: Scratch,
    from: Grid,
    conv: Scratch,
    norm: Norm,
    count: usize,
    rectified: Scratch,
    to: Grid,
    pooled: Arc<Scratch>,
    pooled_grid: Grid,
}

/// A bottleneck's part of the tape.
#[derive(Debug)]
struct Link {
    input: Arc<Scratch>,
    from: Grid,
    /// What else the backward pass needs; made again from the input where it was not kept.
    kept: Option<Kept>,
}

impl Tape {
    /// Runs forward. With `checkpointing`, only the inputs of the bottlenecks are kept, and the
    /// backward pass runs each bottleneck forward once more.
    pub(in crate::encoders) fn record(
        config: &SeResNextConfig,
        context: &Context,
        images: &Images<'_>,
        checkpointing: bool,
        statistics: &mut Vec<BatchStatistics>,
    ) -> Result<Self> {
        let stem = Stem::record(config, context, images, statistics)?;
        let mut input = Arc::clone(&stem.pooled);
        let mut from = stem.pooled_grid;
        let mut bottlenecks = Vec::new();
        for bottleneck in config.bottlenecks() {
            let (kept, output, to) =
                Kept::record(&bottleneck, context, &input, &from, Some(statistics))?;
            bottlenecks.push(Link {
                input,
                from,
                kept: (!checkpointing).then_some(kept),
            });
            (input, from) = (output, to);
        }
        Ok(Self {
            config: *config,
            stem,
            bottlenecks,
            last: input,
            grid: from,
        })
    }

    /// The embeddings, `(frames, width)`.
    pub(in crate::encoders) fn embeddings(&self, context: &Context) -> Vec<f32> {
        let mut means = vec![0.0; self.grid.frames * self.grid.channels];
        let level = context.level;
        crate::ops::mean::frame_means(Threads::All, level, &self.last, &self.grid, &mut means);
        means
    }

    /// The gradients of the parameters, from that of the embeddings.
    pub(in crate::encoders) fn backward(
        &self,
        context: &Context,
        cotangent: &[f32],
    ) -> Result<Gradients> {
        let mut gradients = Gradients::default();
        let mut gradient = context.recycler.take(self.grid.len());
        let share = 1.0 / pixels(self.grid.size) as f32;
        let frames = gradient.chunks_exact_mut(self.grid.frame_len());
        for (frame, cotangent) in frames.zip(cotangent.chunks_exact(self.grid.channels)) {
            for pixel in frame.chunks_exact_mut(self.grid.pitch) {
                for (gradient, cotangent) in pixel.iter_mut().zip(cotangent) {
                    *gradient = cotangent * share;
                }
            }
        }
        let mut output = &self.last;
        for (bottleneck, link) in self
            .config
            .bottlenecks()
            .iter()
            .zip(&self.bottlenecks)
            .rev()
        {
            let again;
            let kept = if let Some(kept) = &link.kept {
                kept
            } else {
                again = Kept::record(bottleneck, context, &link.input, &link.from, None)?.0;
                &again
            };
            gradient =
                kept.backward(bottleneck, context, link, output, gradient, &mut gradients)?;
            output = &link.input;
        }
        self.stem
            .backward(&self.config, context, &gradient, &mut gradients);
        Ok(gradients)
    }
}

const CONV: &str = "layer0.conv1";
const NORM: &str = "layer0.bn1";

/// The 7x7 convolution.
const fn stem_shape(config: &SeResNextConfig) -> ConvShape {
    ConvShape {
        window: STEM,
        inputs: 3,
        outputs: config.stem,
        groups: 1,
    }
}

impl Stem {
    fn record(
        config: &SeResNextConfig,
        context: &Context,
        images: &Images<'_>,
        statistics: &mut Vec<BatchStatistics>,
    ) -> Result<Self> {
        let from = Grid::tight(images.frames(), images.size, 3).padded(&STEM);
        let mut padded = context.recycler.take(from.len());
        from.clear_border(&mut padded);
        let one = Grid { frames: 1, ..from };
        for (image, padded) in images.iter().zip(padded.chunks_exact_mut(from.frame_len())) {
            lay_out(Threads::All, image, images, &one, padded);
        }
        let (conv, to) = context.conv(CONV, stem_shape(config), (&padded, &from))?;
        let (norm, moments) = context.norm(NORM, &conv, &to, Some(statistics))?;
        let mut rectified = context.recycler.take(to.len());
        norm.apply(context.level, &conv, (&mut rectified, &to), true);
        let pooled_grid = Grid {
            size: POOL.output_ceil(to.size),
            ..to
        };
        let mut pooled = context.recycler.take(pooled_grid.len());
        let (source, target) = ((&rectified[..], &to), (&mut pooled[..], &pooled_grid));
        max_pool(Threads::All, context.level, &POOL, source, target);
        Ok(Self {
            images: padded,
            from,
            conv,
            norm,
            count: moments.count,
            rectified,
            to,
            pooled: Arc::new(pooled),
            pooled_grid,
        })
    }

    fn backward(
        &self,
        config: &SeResNextConfig,
        context: &Context,
        gradient: &[f32],
        gradients: &mut Gradients,
    ) {
        let level = context.level;
        let mut spread = context.recycler.take(self.to.len());
        let source = (&self.rectified[..], &self.to);
        let pooled = (&self.pooled[..], &self.pooled_grid);
        max_pool_backward(level, &POOL, source, pooled, gradient, &mut spread);
        let sums = self.norm.sums(level, &self.conv, &spread, &self.to, true);
        let sums = sums.over_frames(self.to.channels);
        let norm = NormGradients::new(&self.norm, self.count, &sums);
        let mut conv = context.recycler.take(self.to.len());
        let target = (&mut conv[..], &self.to);
        self.norm
            .backward(level, &norm.slopes, &self.conv, &spread, target, true);
        gradients.norm(NORM, norm);
        let source = (&self.images[..], &self.from);
        context.weight_gradient(
            CONV,
            &stem_shape(config),
            source,
            (&conv, &self.to),
            gradients,
        );
    }
}
