//! The network in inference, on the CPU kernels.
//!
//! Batch norm is folded into the convolution before it. The gate of a bottleneck is known before
//! its last convolution: the mean of a 1x1 convolution's output is that convolution of the mean
//! of its input. So the gate, the shortcut and the rectifier all happen where the last
//! convolution stores its sums.

use crate::encoders::batch::{Images, Network};
use crate::encoders::folded::{Folded, Layer};
use crate::encoders::images::{image_channels, image_grid, lay_out};
use crate::encoders::plain::BATCH_NORM_EPS;
use crate::encoders::se_resnext::{Bottleneck, POOL, STEM, SeResNextConfig, point};
use crate::error::Result;
use crate::ops::bands::Threads;
use crate::ops::buffer::Buffer;
use crate::ops::conv::ConvShape;
use crate::ops::grid::Grid;
use crate::ops::mean::frame_means;
use crate::ops::pool::max_pool;
use crate::ops::product::{Columns, Epilogue};
use crate::ops::simd::Level;
use crate::ops::words::Word;
use crate::weights::Weights;

/// Stages whose feature maps are so large that a frame at a time stays in the cache.
const LARGE_STAGES: usize = 2;

/// The network with its weights laid out for the kernels.
#[derive(Debug)]
pub(in crate::encoders) struct Fused<W> {
    level: Level,
    stem: Layer<W>,
    stages: Vec<Vec<FusedBottleneck<W>>>,
    width: usize,
}

/// Memory of one thread's passes through the network.
#[derive(Debug, Default)]
pub(in crate::encoders) struct Workspace<W> {
    image: Buffer<W>,
    stem: Buffer<W>,
    /// What enters a bottleneck, and what leaves it.
    features: Buffer<W>,
    shortcut: Buffer<W>,
    reduced: Buffer<W>,
    grouped: Buffer<W>,
    /// The large stages' results of all frames of a group.
    group: Buffer<W>,
}

#[derive(Debug)]
struct FusedBottleneck<W> {
    reduce: Layer<W>,
    grouped: Layer<W>,
    expand: Layer<W>,
    shortcut: Option<Layer<W>>,
    gate: Gate,
}

/// From the mean of the last convolution's input to a factor of each of its outputs.
#[derive(Debug)]
struct Gate {
    hidden: Layer,
    logits: Layer,
}

impl<W: Word> Fused<W> {
    pub(in crate::encoders) fn new(
        config: &SeResNextConfig,
        weights: &Weights,
        level: Level,
    ) -> Result<Self> {
        let shape = ConvShape {
            window: STEM,
            inputs: 3,
            outputs: config.stem,
            groups: 1,
        };
        let (conv, norm) = ("layer0.conv1", "layer0.bn1");
        let stem = Folded::batch_norm(shape, weights, conv, norm, BATCH_NORM_EPS)?;
        let stem = stem.with_inputs(image_channels::<W>()).pack(level);
        let mut stages: Vec<Vec<_>> = (0..4).map(|_| Vec::new()).collect();
        let of_stage = config.depths.iter().enumerate();
        let of_stage = of_stage.flat_map(|(stage, &depth)| std::iter::repeat_n(stage, depth));
        for (bottleneck, stage) in config.bottlenecks().iter().zip(of_stage) {
            stages[stage].push(FusedBottleneck::new(bottleneck, weights, level)?);
        }
        Ok(Self {
            level,
            stem,
            stages,
            width: config.width(),
        })
    }

    /// The stem and its pooling, of one image to `workspace.features`; returns their layout.
    fn stem_features(
        &self,
        threads: Threads,
        image: &[f32],
        images: &Images<'_>,
        workspace: &mut Workspace<W>,
    ) -> Grid {
        let Workspace {
            image: padded,
            stem,
            features,
            ..
        } = workspace;
        let from = image_grid::<W>(images.size).padded(&STEM);
        padded.resize(from.len());
        from.clear_border(padded);
        lay_out(threads, image, images, &from, padded);
        let to = self.stem.output(&from);
        stem.resize(to.len());
        self.stem.apply(threads, (padded, &from), (stem, &to), true);
        let pooled = Grid {
            size: POOL.output_ceil(to.size),
            ..to
        };
        features.resize(pooled.len());
        max_pool(threads, self.level, &POOL, (stem, &to), (features, &pooled));
        pooled
    }
}

impl<W: Word> Network for Fused<W> {
    type Word = W;
    type Workspace = Workspace<W>;

    const GROUP: usize = 4;

    fn width(&self) -> usize {
        self.width
    }

    fn level(&self) -> Level {
        self.level
    }

    fn features<'w>(
        &self,
        threads: Threads,
        images: &Images<'_>,
        workspace: &'w mut Workspace<W>,
    ) -> (&'w [W], Grid) {
        let (large, small) = self.stages.split_at(LARGE_STAGES);
        let mut grid = image_grid::<W>(images.size);
        let frames = images.frames();
        for (frame, image) in images.iter().enumerate() {
            let mut one = self.stem_features(threads, image, images, workspace);
            for bottleneck in large.iter().flatten() {
                one = bottleneck.apply(threads, self.level, one, workspace);
            }
            grid = Grid { frames, ..one };
            if frames > 1 {
                workspace.group.resize(grid.len());
                let len = one.len();
                workspace.group[frame * len..(frame + 1) * len]
                    .copy_from_slice(&workspace.features);
            }
        }
        if frames > 1 {
            std::mem::swap(&mut workspace.features, &mut workspace.group);
        }
        for bottleneck in small.iter().flatten() {
            grid = bottleneck.apply(threads, self.level, grid, workspace);
        }
        (&workspace.features, grid)
    }
}

impl<W: Word> FusedBottleneck<W> {
    fn new(b: &Bottleneck, weights: &Weights, level: Level) -> Result<Self> {
        let normed = |conv: &str, norm: &str, shape| {
            Folded::batch_norm(shape, weights, &b.name(conv), &b.name(norm), BATCH_NORM_EPS)
        };
        let biased = |layer: &str, shape| Folded::bias(shape, weights, &b.name(layer));
        let shortcut = if b.downsample {
            Some(normed("downsample.0", "downsample.1", b.shortcut())?.pack(level))
        } else {
            None
        };
        let expand = normed("conv3", "bn3", b.expand())?;
        let hidden = biased("se_module.fc1", point(b.out, b.squeezed(), 1))?;
        let logits = biased("se_module.fc2", point(b.squeezed(), b.out, 1))?;
        Ok(Self {
            reduce: normed("conv1", "bn1", b.reduce())?.pack(level),
            grouped: normed("conv2", "bn2", b.grouped())?.pack(level),
            gate: Gate {
                hidden: hidden.compose(&expand, level).pack(level),
                logits: logits.pack(level),
            },
            expand: expand.pack(level),
            shortcut,
        })
    }

    /// From `workspace.features`, laid out as `from`, to the same; returns the new layout.
    fn apply(
        &self,
        threads: Threads,
        level: Level,
        from: Grid,
        workspace: &mut Workspace<W>,
    ) -> Grid {
        let Workspace {
            features,
            shortcut,
            reduced,
            grouped,
            ..
        } = workspace;
        let window = &self.grouped.conv.shape().window;
        let middle = self.reduce.output(&from).padded(window);
        reduced.resize(middle.len());
        middle.clear_border(reduced);
        self.reduce
            .apply(threads, (features, &from), (reduced, &middle), true);

        let inner = self.grouped.output(&middle);
        grouped.resize(inner.len());
        self.grouped
            .apply(threads, (reduced, &middle), (grouped, &inner), true);

        let to = self.expand.output(&inner);
        if let Some(layer) = &self.shortcut {
            shortcut.resize(to.len());
            layer.apply(threads, (features, &from), (shortcut, &to), false);
            std::mem::swap(features, shortcut);
        }
        let mut means = vec![0.0; inner.frames * inner.channels];
        frame_means(threads, level, grouped, &inner, &mut means);
        let (scale, shift) = self.factors(inner.frames, &means);
        let epilogue = Epilogue {
            scale: Some(Columns::per_frame(&scale, to.channels)),
            shift: Some(Columns::per_frame(&shift, to.channels)),
            accumulate: true,
            relu: true,
        };
        self.expand
            .conv
            .apply(threads, (grouped, &inner), (features, &to), epilogue);
        to
    }

    /// What the last convolution's outputs are multiplied with and what is added then, each
    /// `(frames, channels)`.
    fn factors(&self, frames: usize, means: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let vectors = |channels| Grid::tight(frames, [1; 3], channels);
        let Gate { hidden, logits } = &self.gate;
        let (inputs, squeezed) = (hidden.conv.shape().inputs, hidden.conv.shape().outputs);
        let channels = logits.conv.shape().outputs;
        let mut between = vec![0.0; frames * squeezed];
        let mut scale = vec![0.0; frames * channels];
        let source = (means, &vectors(inputs));
        hidden.apply(
            Threads::One,
            source,
            (&mut between, &vectors(squeezed)),
            true,
        );
        let source = (&between[..], &vectors(squeezed));
        logits.apply(
            Threads::One,
            source,
            (&mut scale, &vectors(channels)),
            false,
        );
        for logit in &mut scale {
            *logit = 1.0 / (1.0 + (-*logit).exp());
        }
        let biases = self.expand.shift.iter().cycle();
        let shift = scale.iter().zip(biases).map(|(s, b)| s * b).collect();
        (scale, shift)
    }
}

#[cfg(test)]
mod hard_cases;
