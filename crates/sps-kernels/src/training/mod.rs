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

use std::fmt::Debug;
use std::ops::Range;
use std::sync::Arc;

use crate::error::{Error, Result, too_small};
use crate::images::{Images, lay_out};
use crate::inference::Scale;
use crate::network::{IMAGE, Map, Network};
use crate::ops::bands::{Threads, inside_pool};
use crate::ops::buffer::{Recycler, Scratch};
use crate::ops::grid::{Grid, pixels};
use crate::ops::image::Layout;
use crate::ops::mean::frame_means;
use crate::ops::simd::Level;
use crate::ops::words::{Bf16Pair, Real};
use crate::precision::Precision;
use crate::tensors::{self, Tensors};
use layer::Context;
pub use layer::Gradients;
use segment::Kept;

/// A network in training, and memory that one pass leaves to the next. The page of
/// [`network`](crate::network) has an example.
#[derive(Debug, Clone)]
pub struct Training {
    network: Arc<Network>,
    recycler: Arc<Recycler>,
    /// What feature maps and their gradients are made of: f32, or bf16, which takes half the memory. Weights,
    /// their gradients, sums and statistics are f32 with both.
    pub precision: Precision,
    /// Whether only the input of each block is kept for the backward pass, which then runs each block forward
    /// once more. The gradients are the same to the last bit.
    pub checkpointing: bool,
    /// Whether batch norm goes by the running statistics, as in inference, rather than by the batch's own.
    pub running_statistics: bool,
    /// The instructions to run by.
    pub level: Level,
}

/// What a forward pass gives.
#[derive(Debug)]
pub struct Forward {
    /// `(images, width)`
    pub embeddings: Vec<f32>,
    /// What the batch norms saw, in the order they ran; nothing where they went by running statistics.
    pub statistics: Vec<BatchStatistics>,
    /// What the backward pass needs.
    pub pass: Pass,
}

/// A forward pass, kept for its backward pass.
#[derive(Debug)]
pub struct Pass(Box<dyn Backward>);

/// What one batch tells of a batch norm's input.
#[derive(Debug, Clone)]
pub struct BatchStatistics {
    /// The batch norm's name.
    pub layer: String,
    /// `(channels)`
    pub mean: Vec<f32>,
    /// `(channels)`, over the count.
    pub variance: Vec<f32>,
    /// Numbers in one channel.
    pub count: usize,
}

impl BatchStatistics {
    /// Refuses a batch norm that sees a single number in each channel: in training it needs a spread.
    ///
    /// # Errors
    /// A count below 2.
    pub fn check_count(count: usize, layer: &str) -> Result<()> {
        if count >= 2 {
            return Ok(());
        }
        let found = format_args!("one number in each channel at {layer}");
        let expected = "at least two: more images or larger ones";
        Err(Error::input("batch in training", found, expected))
    }
}

impl Training {
    /// In f32, without checkpointing, by the widest instructions that there are.
    pub fn new(network: Arc<Network>) -> Self {
        Self {
            network,
            recycler: Arc::default(),
            precision: Precision::F32,
            checkpointing: false,
            running_statistics: false,
            level: Level::detect(),
        }
    }

    /// Gives back to the system the memory that is kept for the passes to come.
    pub fn shrink(&self) {
        self.recycler.shrink();
    }

    /// Runs forward.
    ///
    /// # Errors
    /// Tensors that are not the network's, images smaller than it takes, a batch norm that sees a single number in
    /// each channel, a precision other than f32 and bf16.
    pub fn forward(&self, tensors: Arc<dyn Tensors>, images: &Images<'_>) -> Result<Forward> {
        tensors::check(&self.network, tensors.as_ref())?;
        let context = Context {
            network: Arc::clone(&self.network),
            tensors,
            recycler: Arc::clone(&self.recycler),
            level: self.level,
            running_statistics: self.running_statistics,
        };
        let record = match self.precision {
            Precision::F32 => Tape::<f32>::record,
            Precision::Bf16 => Tape::<Bf16Pair>::record,
            Precision::Bf16x2 | Precision::Int8 => {
                let (found, expected) = (self.precision, "f32 or bf16");
                return Err(Error::input("precision of training", found, expected));
            }
        };
        inside_pool(|| record(context, images, self.checkpointing))
    }
}

impl Pass {
    /// The gradients of the parameters, from that of the embeddings, `(images, width)`.
    ///
    /// # Errors
    /// A gradient of another length; tensors that are no longer there.
    pub fn backward(&self, cotangent: &[f32]) -> Result<Gradients> {
        self.0.backward(cotangent)
    }
}

/// A pass on words of any kind.
trait Backward: Debug + Send + Sync {
    fn backward(&self, cotangent: &[f32]) -> Result<Gradients>;
}

impl<W: Real> Backward for Tape<W> {
    fn backward(&self, cotangent: &[f32]) -> Result<Gradients> {
        let expected = self.grids[IMAGE].frames * self.context.network.width();
        if cotangent.len() != expected {
            let found = format_args!("{} numbers", cotangent.len());
            return Err(Error::input("gradient of the embeddings", found, expected));
        }
        inside_pool(|| self.gradients(cotangent))
    }
}

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
struct Tape<W: Real> {
    context: Context,
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
    /// Runs forward. With `checkpointing`, only the inputs of the segments are kept, and the backward pass runs each
    /// segment forward once more.
    fn record(context: Context, images: &Images<'_>, checkpointing: bool) -> Result<Forward> {
        let sizes = context.network.sizes(images.size);
        let sizes = sizes.ok_or_else(|| too_small(images.size))?;
        let (frames, width) = (images.frames(), context.network.width());
        let grids = context.network.grids::<W>(frames, &sizes, |map| map);
        let mut input = Arc::new(images_value(&context, images, grids[IMAGE]));
        let (mut segments, mut statistics) = (Vec::new(), Vec::new());
        let mut embeddings = vec![0.0; frames * width];
        for layers in ranges(&context.network) {
            let (end, noted) = (layers.end, Some(&mut statistics));
            let (kept, output) = Kept::record(&context, layers.clone(), &input, &grids, noted)?;
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
        let tape = Self {
            context,
            segments,
            grids,
        };
        Ok(Forward {
            embeddings,
            statistics,
            pass: Pass(Box::new(tape)),
        })
    }

    /// The gradients of the parameters, from that of the embeddings.
    fn gradients(&self, cotangent: &[f32]) -> Result<Gradients> {
        let context = &self.context;
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
    let rows = Layout::Rows.memory::<W>(&grid);
    let mut memory = context.recycler.take(rows.len());
    let one = Grid { frames: 1, ..grid };
    let frames = memory.chunks_exact_mut(rows.frame_len());
    for (image, memory) in images.iter().zip(frames) {
        let by = (Threads::All, context.level);
        lay_out(by, image, images, (memory, &one, Layout::Rows), Scale::UNIT);
    }
    Value { memory, grid }
}

/// The layers cut at each map that is alone: all made before it have been read.
fn ranges(network: &Network) -> Vec<Range<usize>> {
    let cuts: Vec<Map> = network.alone().collect();
    cuts.windows(2).map(|ends| ends[0]..ends[1]).collect()
}
