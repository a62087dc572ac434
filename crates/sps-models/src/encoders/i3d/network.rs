//! The network on the CPU kernels.
//!
//! Batch norm is folded into the convolution before it. A feature map lies in memory with the
//! padding of the endpoint that reads it; the branches of a mixed endpoint write side by side.

use super::{ENDPOINTS, EPS, Endpoint, WIDTH, branches};
use crate::encoders::batch::{self, Images};
use crate::encoders::folded::{Folded, Layer};
use crate::encoders::images::lay_out;
use crate::error::Result;
use crate::ops::bands::Threads;
use crate::ops::buffer::Buffer;
use crate::ops::conv::ConvShape;
use crate::ops::grid::{Grid, Size, Window};
use crate::ops::pool::max_pool;
use crate::ops::simd::Level;
use crate::weights::Weights;

/// The network with its weights laid out for the kernels.
#[derive(Debug)]
pub(super) struct Network {
    level: Level,
    layers: Vec<Layers>,
}

/// The weights of one endpoint.
#[derive(Debug)]
enum Layers {
    Unit(Layer),
    Pool,
    Mixed(Box<[Layer; 6]>),
}

/// Memory of one thread's passes through the network.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    /// What enters an endpoint, and what leaves it.
    features: Buffer,
    next: Buffer,
    /// What passes between two units of a branch.
    between: Buffer,
}

/// The window of a unit of stride 1.
fn window(size: usize) -> Window {
    Window::same([size; 3], [1; 3], [1; 3])
}

/// The window that an endpoint moves over a feature map, padded as it is there.
fn padded(endpoint: Endpoint, input: Size) -> Window {
    match endpoint {
        Endpoint::Unit(_, _, _, size, stride) => Window::same([size; 3], [stride; 3], input),
        Endpoint::Pool(size, stride) => Window::same(size, stride, input),
        Endpoint::Mixed(..) => window(3),
    }
}

impl Network {
    pub(super) fn new(weights: &Weights, level: Level) -> Result<Self> {
        let layer = |name: &str, shape| -> Result<Layer> {
            let (conv, norm) = (format!("{name}.conv3d"), format!("{name}.bn"));
            Ok(Folded::batch_norm(shape, weights, &conv, &norm, EPS)?.pack(level))
        };
        let shape = |window, inputs, outputs| ConvShape {
            window,
            inputs,
            outputs,
            groups: 1,
        };
        let layers = ENDPOINTS.iter().map(|endpoint| {
            Ok(match *endpoint {
                Endpoint::Pool(..) => Layers::Pool,
                Endpoint::Unit(name, input, out, size, stride) => {
                    // The padding hangs on the input and counts as part of it.
                    let bare = Window {
                        size: [size; 3],
                        stride: [stride; 3],
                        before: [0; 3],
                        after: [0; 3],
                    };
                    Layers::Unit(layer(name, shape(bare, input, out))?)
                }
                Endpoint::Mixed(name, input, outs) => {
                    let layers = branches(input, outs).map(|(branch, input, out, size)| {
                        layer(&format!("{name}.{branch}"), shape(window(size), input, out))
                    });
                    let [b0, b1a, b1b, b2a, b2b, b3b] = layers;
                    Layers::Mixed(Box::new([b0?, b1a?, b1b?, b2a?, b2b?, b3b?]))
                }
            })
        });
        Ok(Self {
            level,
            layers: layers.collect::<Result<_>>()?,
        })
    }

    /// Runs one endpoint, from `workspace.features`, laid out as `from`, to the same, with the padding
    /// of `next` around it.
    fn run(
        &self,
        threads: Threads,
        (endpoint, layers): (Endpoint, &Layers),
        from: &Grid,
        next: Option<&Endpoint>,
        workspace: &mut Workspace,
    ) -> Grid {
        let moved = padded(endpoint, from.size);
        let size = moved.output(from.size).unwrap_or([0; 3]);
        let channels = match layers {
            Layers::Unit(layer) => layer.conv.shape().outputs,
            Layers::Pool => from.channels,
            Layers::Mixed(layers) => {
                let [b0, _, b1b, _, b2b, b3b] = layers.as_ref();
                [b0, b1b, b2b, b3b]
                    .map(|b| b.conv.shape().outputs)
                    .iter()
                    .sum()
            }
        };
        let tight = Grid::tight(from.frames, size, channels);
        let to = next.map_or(tight, |next| tight.padded(&padded(*next, size)));
        workspace.next.resize(to.len());
        to.clear_border(&mut workspace.next);
        match layers {
            Layers::Unit(layer) => {
                let extents = [0, 1, 2].map(|axis| from.extent(axis));
                let whole = Grid::tight(from.frames, extents, from.channels);
                let target = (&mut workspace.next[..], &to);
                layer.apply(threads, (&workspace.features, &whole), target, true);
            }
            Layers::Pool => {
                let source = (&workspace.features[..], from);
                let target = (&mut workspace.next[..], &to);
                max_pool(threads, self.level, &moved, source, target);
            }
            Layers::Mixed(layers) => self.mixed(threads, layers, from, &to, workspace),
        }
        std::mem::swap(&mut workspace.features, &mut workspace.next);
        to
    }

    /// The four branches, each into its own channels.
    fn mixed(
        &self,
        threads: Threads,
        layers: &[Layer; 6],
        from: &Grid,
        to: &Grid,
        workspace: &mut Workspace,
    ) {
        let [b0, b1a, b1b, b2a, b2b, b3b] = layers;
        let Workspace {
            features,
            next,
            between,
        } = workspace;
        let features = (&features[..], from);
        let mut column = 0;
        b0.apply(threads, features, (next, to), true);
        column += b0.conv.shape().outputs;
        for (first, second) in [(b1a, b1b), (b2a, b2b)] {
            let middle = first.output(from).padded(&window(3));
            between.resize(middle.len());
            middle.clear_border(between);
            first.apply(threads, features, (between, &middle), true);
            let target = (&mut next[column..], to);
            second.apply(threads, (between, &middle), target, true);
            column += second.conv.shape().outputs;
        }
        let pooled = Grid::tight(from.frames, from.size, from.channels);
        between.resize(pooled.len());
        let target = (&mut between[..], &pooled);
        max_pool(threads, self.level, &window(3), features, target);
        b3b.apply(threads, (between, &pooled), (&mut next[column..], to), true);
    }
}

impl batch::Network for Network {
    type Word = f32;
    type Workspace = Workspace;

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
        sequences: &Images<'_>,
        workspace: &'w mut Workspace,
    ) -> (&'w [f32], Grid) {
        let tight = Grid::tight(1, sequences.size, 3);
        let mut grid = tight.padded(&padded(ENDPOINTS[0], sequences.size));
        workspace.features.resize(grid.len());
        grid.clear_border(&mut workspace.features);
        for sequence in sequences.iter() {
            let memory = &mut workspace.features;
            lay_out(threads, sequence, sequences, &grid, memory);
        }
        for (index, layers) in self.layers.iter().enumerate() {
            let next = ENDPOINTS.get(index + 1);
            grid = self.run(threads, (ENDPOINTS[index], layers), &grid, next, workspace);
        }
        (&workspace.features, grid)
    }
}
