//! The network in inference, on the CPU kernels.

use super::{MODULES, Module, POINT, POOL, SQUARE, STEM, STEM_WINDOW, WIDTH};
use crate::encoders::batch::{Images, Network};
use crate::encoders::folded::{Folded, Layer};
use crate::encoders::images::{image_channels, image_grid, lay_out};
use crate::error::Result;
use crate::ops::bands::Threads;
use crate::ops::buffer::Buffer;
use crate::ops::conv::ConvShape;
use crate::ops::grid::Grid;
use crate::ops::pool::max_pool;
use crate::ops::simd::Level;
use crate::ops::words::Word;
use crate::weights::Weights;

/// The network with its weights laid out for the kernels.
#[derive(Debug)]
pub(in crate::encoders) struct Fused<W> {
    level: Level,
    stem: Layer<W>,
    modules: Vec<FusedModule<W>>,
}

/// Memory of one thread's passes through the network.
#[derive(Debug, Default)]
pub(in crate::encoders) struct Workspace<W> {
    image: Buffer<W>,
    /// What enters a module, and what leaves it.
    features: Buffer<W>,
    next: Buffer<W>,
    squeezed: Buffer<W>,
}

#[derive(Debug)]
enum FusedModule<W> {
    Pool,
    Fire(Box<Fire<W>>),
}

#[derive(Debug)]
struct Fire<W> {
    squeeze: Layer<W>,
    point: Layer<W>,
    square: Layer<W>,
}

impl<W: Word> Fused<W> {
    pub(in crate::encoders) fn new(weights: &Weights, level: Level) -> Result<Self> {
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
            folded(name, window, inputs, outputs).map(|folded| folded.pack(level))
        };
        let stem = folded("features.0", STEM_WINDOW, 3, STEM)?;
        let inputs = image_channels::<W>();
        let module = |module: &Module| {
            let Module::Fire {
                index,
                input,
                squeeze,
                expand,
            } = *module
            else {
                return Ok(FusedModule::Pool);
            };
            let name = |leaf: &str| format!("features.{index}.{leaf}");
            Ok(FusedModule::Fire(Box::new(Fire {
                squeeze: layer(&name("squeeze"), POINT, input, squeeze)?,
                point: layer(&name("expand1x1"), POINT, squeeze, expand)?,
                square: layer(&name("expand3x3"), SQUARE, squeeze, expand)?,
            })))
        };
        Ok(Self {
            level,
            stem: stem.with_inputs(inputs).pack(level),
            modules: MODULES.iter().map(module).collect::<Result<_>>()?,
        })
    }

    /// Runs one module, from `workspace.features`, laid out as `from`, to the same.
    fn run(
        &self,
        threads: Threads,
        module: &FusedModule<W>,
        from: Grid,
        workspace: &mut Workspace<W>,
    ) -> Grid {
        let Workspace {
            features,
            next,
            squeezed,
            ..
        } = workspace;
        let to = match module {
            FusedModule::Pool => {
                let to = Grid {
                    size: POOL.output_ceil(from.size),
                    ..from
                };
                next.resize(to.len());
                max_pool(threads, self.level, &POOL, (features, &from), (next, &to));
                to
            }
            FusedModule::Fire(fire) => {
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
                    .of::<W>()
                    .staggered();
                next.resize(to.len());
                point.apply(threads, (squeezed, &middle), (next, &to), true);
                let right = &mut next[half.words..];
                square.apply(threads, (squeezed, &middle), (right, &to), true);
                to
            }
        };
        std::mem::swap(features, next);
        to
    }
}

impl<W: Word> Network for Fused<W> {
    type Word = W;
    type Workspace = Workspace<W>;

    const GROUP: usize = 1;

    fn width(&self) -> usize {
        WIDTH
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
        let from = image_grid::<W>(images.size);
        workspace.image.resize(from.len());
        for image in images.iter() {
            lay_out(threads, image, images, &from, &mut workspace.image);
        }
        let mut grid = self.stem.output(&from);
        workspace.features.resize(grid.len());
        let target = (&mut workspace.features[..], &grid);
        self.stem
            .apply(threads, (&workspace.image, &from), target, true);
        for module in &self.modules {
            grid = self.run(threads, module, grid, workspace);
        }
        (&workspace.features, grid)
    }
}
