//! The network in inference, on the CPU kernels.

use super::{POINT, POOL, SQUARE, STEM, STEM_WINDOW, STEPS, Step, WIDTH};
use crate::encoders::batch::{Images, Network};
use crate::encoders::folded::{Folded, Layer};
use crate::encoders::images::{image_grid, lay_out};
use crate::error::Result;
use crate::ops::bands::Threads;
use crate::ops::buffer::Buffer;
use crate::ops::conv::ConvShape;
use crate::ops::format::Format;
use crate::ops::grid::Grid;
use crate::ops::mean::frame_means;
use crate::ops::pool::max_pool;
use crate::ops::simd::Level;
use crate::weights::Weights;

/// The network with its weights laid out for the kernels.
#[derive(Debug)]
pub(in crate::encoders) struct Fused {
    level: Level,
    /// Of the feature maps.
    format: Format,
    stem: Layer,
    steps: Vec<FusedStep>,
}

/// Memory of one thread's passes through the network.
#[derive(Debug, Default)]
pub(in crate::encoders) struct Workspace {
    image: Buffer,
    /// What enters a step, and what leaves it.
    features: Buffer,
    next: Buffer,
    squeezed: Buffer,
}

#[derive(Debug)]
enum FusedStep {
    Pool,
    Fire(Box<Fire>),
}

#[derive(Debug)]
struct Fire {
    squeeze: Layer,
    point: Layer,
    square: Layer,
}

impl Fused {
    pub(in crate::encoders) fn new(
        weights: &Weights,
        level: Level,
        format: Format,
    ) -> Result<Self> {
        let folded = |name: &str, window, inputs, outputs| {
            let shape = ConvShape {
                window,
                inputs,
                outputs,
                groups: 1,
            };
            Folded::bias(shape, weights, name)
        };
        let layer = |name: &str, window, inputs, outputs| {
            folded(name, window, inputs, outputs).map(|folded| folded.pack(level, format))
        };
        let stem = folded("features.0", STEM_WINDOW, 3, STEM)?;
        let inputs = image_grid([1; 3], format).channels;
        let step = |step: &Step| {
            let Step::Fire {
                index,
                input,
                squeeze,
                expand,
            } = *step
            else {
                return Ok(FusedStep::Pool);
            };
            let name = |leaf: &str| format!("features.{index}.{leaf}");
            Ok(FusedStep::Fire(Box::new(Fire {
                squeeze: layer(&name("squeeze"), POINT, input, squeeze)?,
                point: layer(&name("expand1x1"), POINT, squeeze, expand)?,
                square: layer(&name("expand3x3"), SQUARE, squeeze, expand)?,
            })))
        };
        Ok(Self {
            level,
            format,
            stem: stem.with_inputs(inputs).pack(level, format),
            steps: STEPS.iter().map(step).collect::<Result<_>>()?,
        })
    }

    /// One step from `workspace.features`, laid out as `from`, to the same.
    fn step(
        &self,
        threads: Threads,
        step: &FusedStep,
        from: Grid,
        workspace: &mut Workspace,
    ) -> Grid {
        let Workspace {
            features,
            next,
            squeezed,
            ..
        } = workspace;
        let to = match step {
            FusedStep::Pool => {
                let to = Grid {
                    size: POOL.output_ceil(from.size),
                    ..from
                };
                next.resize(to.len());
                max_pool(threads, self.level, &POOL, (features, &from), (next, &to));
                to
            }
            FusedStep::Fire(fire) => {
                let Fire {
                    squeeze,
                    point,
                    square,
                } = fire.as_ref();
                let middle = squeeze.output(&from).padded(&SQUARE);
                squeezed.resize(middle.len());
                middle.clear_border(squeezed);
                squeeze.apply(threads, (features, &from), (squeezed, &middle), true);
                let half = point.output(&middle);
                let to = Grid::tight(half.frames, half.size, 2 * half.channels)
                    .in_format(self.format)
                    .staggered();
                next.resize(to.len());
                point.apply(threads, (squeezed, &middle), (next, &to), true);
                let right = &mut next[half.words()..];
                square.apply(threads, (squeezed, &middle), (right, &to), true);
                to
            }
        };
        std::mem::swap(features, next);
        to
    }
}

impl Network for Fused {
    type Workspace = Workspace;

    fn width(&self) -> usize {
        WIDTH
    }

    fn embed(
        &self,
        threads: Threads,
        images: &Images<'_>,
        workspace: &mut Workspace,
        embeddings: &mut [f32],
    ) {
        for (image, embedding) in images.iter().zip(embeddings.chunks_exact_mut(WIDTH)) {
            let from = image_grid(images.size, self.format);
            workspace.image.resize(from.len());
            lay_out(threads, image, images, &from, &mut workspace.image);
            let mut grid = self.stem.output(&from);
            workspace.features.resize(grid.len());
            let target = (&mut workspace.features[..], &grid);
            self.stem
                .apply(threads, (&workspace.image, &from), target, true);
            for step in &self.steps {
                grid = self.step(threads, step, grid, workspace);
            }
            frame_means(threads, self.level, &workspace.features, &grid, embedding);
        }
    }
}
