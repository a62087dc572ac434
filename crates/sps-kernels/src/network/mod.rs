//! A network as data: a list of layers, which the executors walk.
//!
//! Its tensors, multiply-adds, widths and the extents that it takes follow from the list.
//!
//! ```
#![doc = include_str!("../../examples/network.rs")]
//! ```

mod depths;

use std::ops::Range;

pub use depths::{Block, Depths};

use crate::error::Result;
use crate::images::Normalisation;
use crate::ops::conv::ConvShape;
use crate::ops::grid::{Grid, Size, Window};
use crate::ops::product::Activation;
use crate::ops::words::Word;
use crate::tensors::TensorSpec;

/// A feature map of a network by its number: that of the image is 0, and each layer's is one more
/// than that of the layer before it.
pub type Map = usize;

/// The image, which every network begins with.
pub const IMAGE: Map = 0;

/// No network needs larger images.
const LARGEST_MIN_SIZE: usize = 64;

/// A network without its weights.
#[derive(Debug, Clone)]
pub struct Network {
    /// What errors call it.
    pub name: &'static str,
    /// What it takes out of its input.
    pub normalisation: Normalisation,
    /// What its batch norms add to a variance.
    pub eps: f64,
    /// What the names of its classifier's tensors begin with.
    pub classifier: &'static str,
    /// Whether it takes sequences of frames: its weights then have a time axis.
    pub sequences: bool,
    /// Other files' names of its layers, each with its own name.
    pub aliases: Vec<(String, String)>,
    /// The layers, each reading maps made before it.
    pub layers: Vec<Layer>,
    /// Channels of each map.
    pub channels: Vec<usize>,
    /// The maps whose means over space make an embedding, in the order of the layers.
    pub depths: Vec<Depth>,
}

/// A map that embeddings have a block of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Depth {
    /// What configurations call it.
    pub name: String,
    /// The map.
    pub map: Map,
}

/// What makes one feature map of others.
#[derive(Debug, Clone)]
pub enum Layer {
    /// A convolution.
    Conv(Conv),
    /// The end of a residual branch: `activation(conv * gate + shortcut)`. Nothing reads the
    /// shortcut's map later.
    Residual {
        /// The last convolution of the branch.
        conv: Conv,
        /// What its output is multiplied with.
        gate: Option<Gate>,
        /// What is added.
        shortcut: Map,
    },
    /// Convolutions side by side, each into its own channels.
    Concat(Vec<Conv>),
    /// Max pooling.
    MaxPool(MaxPool),
}

/// A convolution, the batch norm or the bias after it, and its activation.
#[derive(Debug, Clone)]
pub struct Conv {
    /// The map that it reads.
    pub input: Map,
    /// What the names of its tensors begin with.
    pub name: String,
    /// Its window.
    pub slide: Slide,
    /// Channels that go in.
    pub inputs: usize,
    /// Channels that come out.
    pub outputs: usize,
    /// Parts that the channels are in, each convolved by itself.
    pub groups: usize,
    /// The name of the batch norm; a bias where there is none.
    pub norm: Option<String>,
    /// What becomes of the numbers that leave it.
    pub activation: Activation,
}

/// Squeeze and excitation (Hu et al., CVPR 2018): from the mean of a map over space, by a rectified
/// layer and a logistic one, to a factor of each channel. The map is that of a 1x1 convolution.
#[derive(Debug, Clone)]
pub struct Gate {
    /// The names of the two layers.
    pub layers: [String; 2],
    /// Channels of the map.
    pub channels: usize,
    /// Channels between the layers.
    pub hidden: usize,
}

/// Max pooling of a map that has no negative values: zeros around it change nothing.
#[derive(Debug, Clone)]
pub struct MaxPool {
    /// The map that it reads.
    pub input: Map,
    /// Its window.
    pub slide: Slide,
    /// Whether the last window may hang over the edge.
    pub ceil: bool,
}

/// How a window slides over a feature map.
#[derive(Debug, Clone, Copy)]
pub enum Slide {
    /// As a window says.
    Padded(Window),
    /// Padded so that the stride alone decides the extents, with the odd pixel at the upper end.
    Same {
        /// Pixels under the window.
        size: Size,
        /// Pixels from one place of the window to the next.
        stride: Size,
    },
}

impl Slide {
    /// A square window over images, padded alike on all sides.
    pub const fn square(size: usize, stride: usize, padding: usize) -> Self {
        Self::Padded(Window::square(size, stride, padding))
    }

    /// A square window over images, padded as TensorFlow's 'same'.
    pub const fn same(size: usize, stride: usize) -> Self {
        Self::Same {
            size: [1, size, size],
            stride: [1, stride, stride],
        }
    }

    /// The window on a map of such extents.
    pub fn window(&self, input: Size) -> Window {
        match *self {
            Self::Padded(window) => window,
            Self::Same { size, stride } => Window::same(size, stride, input),
        }
    }

    /// Pixels under the window.
    pub fn size(&self) -> Size {
        self.window([1; 3]).size
    }
}

impl Conv {
    /// A convolution with a bias, of one group, without an activation.
    pub fn new(name: impl Into<String>, slide: Slide, outputs: usize) -> Self {
        Self {
            input: IMAGE,
            name: name.into(),
            slide,
            inputs: 0,
            outputs,
            groups: 1,
            norm: None,
            activation: Activation::Identity,
        }
    }

    /// With a batch norm in place of the bias.
    #[must_use]
    pub fn norm(mut self, name: impl Into<String>) -> Self {
        self.norm = Some(name.into());
        self
    }

    /// In so many groups.
    #[must_use]
    pub fn groups(mut self, groups: usize) -> Self {
        self.groups = groups;
        self
    }

    /// With an activation.
    #[must_use]
    pub fn activation(mut self, activation: Activation) -> Self {
        self.activation = activation;
        self
    }

    /// Rectified.
    #[must_use]
    pub fn relu(self) -> Self {
        self.activation(Activation::Relu)
    }

    /// Its shape on a map of such extents.
    pub fn shape(&self, input: Size) -> ConvShape {
        ConvShape {
            window: self.slide.window(input),
            inputs: self.inputs,
            outputs: self.outputs,
            groups: self.groups,
        }
    }
}

impl MaxPool {
    /// The extents that come of such.
    pub fn output(&self, input: Size) -> Option<Size> {
        let window = self.slide.window(input);
        if self.ceil {
            Some(window.output_ceil(input))
        } else {
            window.output(input)
        }
    }
}

impl Layer {
    /// Its convolutions.
    pub fn convs(&self) -> &[Conv] {
        match self {
            Self::Conv(conv) | Self::Residual { conv, .. } => std::slice::from_ref(conv),
            Self::Concat(convs) => convs,
            Self::MaxPool(_) => &[],
        }
    }

    /// The maps that windows slide over, with those.
    pub fn slides(&self) -> impl Iterator<Item = (Map, Slide)> {
        let pool = match self {
            Self::MaxPool(pool) => Some((pool.input, pool.slide)),
            _ => None,
        };
        let convs = self.convs().iter().map(|conv| (conv.input, conv.slide));
        pool.into_iter().chain(convs)
    }

    /// The maps that it reads.
    pub fn inputs(&self) -> impl Iterator<Item = Map> {
        self.slides().map(|(map, _)| map).chain(self.shortcut())
    }

    /// The map that it is added to, where it is the end of a residual branch.
    pub(crate) fn shortcut(&self) -> Option<Map> {
        match self {
            Self::Residual { shortcut, .. } => Some(*shortcut),
            _ => None,
        }
    }

    /// The squeeze-and-excitation gate, where it has one.
    pub(crate) fn gate(&self) -> Option<&Gate> {
        match self {
            Self::Residual { gate, .. } => gate.as_ref(),
            _ => None,
        }
    }
}

impl Network {
    /// A network of no layer, on images normalised as ImageNet's, with PyTorch's batch norm.
    pub fn new(name: &'static str, classifier: &'static str) -> Self {
        Self {
            name,
            normalisation: Normalisation::IMAGENET,
            eps: 1e-5,
            classifier,
            sequences: false,
            aliases: Vec::new(),
            layers: Vec::new(),
            channels: vec![3],
            depths: Vec::new(),
        }
    }

    /// Makes the last map one that embeddings have a block of.
    pub fn depth(&mut self, name: impl Into<String>) {
        let (name, map) = (name.into(), self.layers.len());
        self.depths.push(Depth { name, map });
    }

    /// The network as far as embeddings of these depths need it.
    ///
    /// # Errors
    /// No depth, one that the network does not have, one named twice.
    pub fn at(mut self, depths: &Depths) -> Result<Self> {
        depths.choose(self.name, &mut self.depths)?;
        let end = self.depths.last().map_or(IMAGE, |depth| depth.map);
        self.layers.truncate(end);
        self.channels.truncate(end + 1);
        Ok(self)
    }

    /// Pixels from one place of the window over the images to the next.
    pub(crate) fn image_stride(&self) -> Size {
        let mut slides = self.layers.iter().flat_map(Layer::slides);
        let reader = slides.find(|(map, _)| *map == IMAGE);
        reader.map_or([1; 3], |(_, slide)| slide.window([1; 3]).stride)
    }

    /// Adds a convolution of a map.
    pub fn conv(&mut self, input: Map, conv: Conv) -> Map {
        let conv = self.reading(input, conv);
        self.add(conv.outputs, Layer::Conv(conv))
    }

    /// Adds convolutions of maps side by side.
    pub fn concat(&mut self, convs: Vec<(Map, Conv)>) -> Map {
        let convs = convs.into_iter();
        let convs: Vec<Conv> = convs.map(|(map, conv)| self.reading(map, conv)).collect();
        self.add(convs.iter().map(|c| c.outputs).sum(), Layer::Concat(convs))
    }

    /// Adds the last convolution of a residual branch, and what it is gated by and added to.
    pub fn residual(&mut self, input: Map, conv: Conv, gate: Option<Gate>, shortcut: Map) -> Map {
        let conv = self.reading(input, conv);
        let layer = Layer::Residual {
            gate,
            shortcut,
            conv,
        };
        self.add(self.channels[shortcut], layer)
    }

    /// Adds max pooling of a map.
    pub fn max_pool(&mut self, input: Map, slide: Slide, ceil: bool) -> Map {
        let pool = MaxPool { input, slide, ceil };
        self.add(self.channels[input], Layer::MaxPool(pool))
    }

    /// Takes another name for a layer.
    pub fn alias(&mut self, own: &str, other: &str) {
        self.aliases.push((other.to_owned(), own.to_owned()));
    }

    /// The convolution as one of a map.
    fn reading(&self, input: Map, conv: Conv) -> Conv {
        Conv {
            input,
            inputs: self.channels[input],
            ..conv
        }
    }

    fn add(&mut self, channels: usize, layer: Layer) -> Map {
        self.layers.push(layer);
        self.channels.push(channels);
        self.channels.len() - 1
    }

    /// The length of an embedding: the channels of the maps at its depths.
    pub fn width(&self) -> usize {
        self.blocks().map(|(_, channels)| channels.len()).sum()
    }

    /// The depths of an embedding by name.
    pub fn named_blocks(&self) -> Vec<Block> {
        let block = |depth: &Depth| Block {
            name: depth.name.clone(),
            width: self.channels[depth.map],
        };
        self.depths.iter().map(block).collect()
    }

    /// The maps at the depths of an embedding, each with its place in there.
    pub fn blocks(&self) -> impl Iterator<Item = (Map, Range<usize>)> {
        self.depths.iter().scan(0, |start, depth| {
            let place = *start..*start + self.channels[depth.map];
            *start = place.end;
            Some((depth.map, place))
        })
    }

    /// The place of a map in embeddings, where they have a block of it.
    pub fn block(&self, map: Map) -> Option<Range<usize>> {
        let mut blocks = self.blocks();
        blocks.find_map(|(other, range)| (other == map).then_some(range))
    }

    /// The extents of each map of an image; `None` where it is too small or too large for a number.
    pub fn sizes(&self, image: Size) -> Option<Vec<Size>> {
        let mut sizes = vec![image];
        for layer in &self.layers {
            sizes.push(if let Layer::MaxPool(pool) = layer {
                pool.output(sizes[pool.input])?
            } else {
                let conv = layer.convs().first()?;
                let input = sizes[conv.input];
                conv.slide.window(input).output(input)?
            });
        }
        Some(sizes)
    }

    /// The layout of each map of so many frames and such a size, with the border that readers of the map need and of
    /// those that it is a `host` of.
    pub(crate) fn grids<W: Word>(
        &self,
        frames: usize,
        sizes: &[Size],
        host: impl Fn(Map) -> Map,
    ) -> Vec<Grid> {
        let maps = sizes.iter().zip(&self.channels);
        let tight = |(&size, &channels)| Grid::tight(frames, size, channels).of::<W>();
        let mut grids: Vec<Grid> = maps.map(|map| tight(map).staggered()).collect();
        for (map, slide) in self.layers.iter().flat_map(Layer::slides) {
            let host = host(map);
            grids[host] = grids[host].enclosing(&slide.window(sizes[map]));
        }
        grids
    }

    /// The maps that are alone: all made before them have been read.
    pub(crate) fn alone(&self) -> impl DoubleEndedIterator<Item = Map> {
        let last_readers = self.last_readers();
        let alone = move |map: &Map| last_readers[..*map].iter().all(|&last| last < *map);
        (0..=self.layers.len()).filter(alone)
    }

    /// Pixels of the image from one pixel of each map to the next, from the upper to the lower.
    pub fn strides(&self) -> Vec<usize> {
        let mut strides = vec![1];
        for layer in &self.layers {
            let slides = layer.slides();
            let stride = slides.map(|(map, slide)| strides[map] * slide.window([1; 3]).stride[1]);
            strides.push(stride.max().unwrap_or(1));
        }
        strides
    }

    /// The smallest height and width of an image.
    pub fn min_size(&self) -> usize {
        let takes = |side: &usize| self.sizes([1, *side, *side]).is_some();
        let least = (1..LARGEST_MIN_SIZE).find(takes);
        least.unwrap_or(LARGEST_MIN_SIZE)
    }

    /// Multiply-adds for one image of so many pixels: those of the convolutions and of the gates; `None`
    /// where there are no pixels, or no number holds them.
    pub fn multiply_adds(&self, image: Size) -> Option<u64> {
        let sizes = self.sizes(image).filter(|_| !image.contains(&0))?;
        let mut count = 0_u64;
        for layer in &self.layers {
            for conv in layer.convs() {
                let input = sizes[conv.input];
                count = conv.shape(input).multiply_adds(input)?.checked_add(count)?;
            }
            if let Some(gate) = layer.gate() {
                count = count.checked_add(2 * (gate.channels * gate.hidden) as u64)?;
            }
        }
        Some(count)
    }

    /// For each map the number of the last layer that reads it; of the last map, of one more than
    /// there are.
    pub fn last_readers(&self) -> Vec<usize> {
        let mut last = vec![self.layers.len(); self.channels.len()];
        for (number, layer) in self.layers.iter().enumerate() {
            layer.inputs().for_each(|map| last[map] = number);
        }
        last
    }

    /// The tensors, in the order of the layers.
    pub fn specs(&self) -> Vec<TensorSpec> {
        let mut specs = Vec::new();
        for layer in &self.layers {
            for conv in layer.convs() {
                self.conv_specs(conv, &mut specs);
            }
            if let Some(gate) = layer.gate() {
                let [hidden, logits] = &gate.layers;
                let sides = [
                    (hidden, gate.hidden, gate.channels),
                    (logits, gate.channels, gate.hidden),
                ];
                for (name, outputs, inputs) in sides {
                    let shape = [outputs, inputs, 1, 1];
                    specs.push(TensorSpec::new(format!("{name}.weight"), &shape));
                    specs.push(TensorSpec::new(format!("{name}.bias"), &shape[..1]));
                }
            }
        }
        specs
    }

    fn conv_specs(&self, conv: &Conv, specs: &mut Vec<TensorSpec>) {
        let name = &conv.name;
        let mut shape = vec![conv.outputs, conv.inputs / conv.groups];
        shape.extend(&conv.slide.size()[usize::from(!self.sequences)..]);
        specs.push(TensorSpec::new(format!("{name}.weight"), &shape));
        let mut vector = |layer: &str, leaf: &str| {
            specs.push(TensorSpec::new(format!("{layer}.{leaf}"), &shape[..1]));
        };
        match &conv.norm {
            Some(norm) => {
                for leaf in ["weight", "bias", "running_mean", "running_var"] {
                    vector(norm, leaf);
                }
            }
            None => vector(name, "bias"),
        }
    }

    /// Whether a weights file may hold this tensor though the embedding does not need it: the
    /// classifier, and batch norm's count of batches.
    pub fn passes(&self, tensor: &str) -> bool {
        tensor.starts_with(self.classifier) || tensor.ends_with(".num_batches_tracked")
    }

    /// The name that a tensor of a file has here.
    pub fn own_name(&self, tensor: &str) -> Option<String> {
        let (layer, leaf) = tensor.rsplit_once('.')?;
        let (_, own) = self.aliases.iter().find(|(other, _)| other == layer)?;
        Some(format!("{own}.{leaf}"))
    }
}
