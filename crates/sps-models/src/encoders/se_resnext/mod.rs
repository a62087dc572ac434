//! Squeeze-and-excitation ResNeXt (Hu et al., "Squeeze-and-Excitation Networks", CVPR 2018), in
//! the layout of Cadene's and timm's `legacy_seresnext50_32x4d`.

pub(super) mod train;

use crate::ops::Window;
use crate::ops::conv::ConvShape;

/// The size of a squeeze-and-excitation ResNeXt.
///
/// Four stages of bottlenecks, each a 1x1 convolution, a grouped 3x3 convolution, a 1x1
/// convolution and a squeeze-and-excitation gate on the residual branch. A stage halves height
/// and width (but for the first) and doubles both channel counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SeResNextConfig {
    /// Channels of the 7x7 stem.
    pub(super) stem: usize,
    /// Bottlenecks in each stage.
    pub(super) depths: [usize; 4],
    /// Groups of the 3x3 convolutions.
    pub(super) groups: usize,
    /// Channels of one group in the first stage.
    pub(super) group_width: usize,
    /// Channels that leave a bottleneck of the first stage.
    pub(super) out: usize,
}

impl SeResNextConfig {
    /// The paper's encoder: 50 layers, 32 groups of 4 channels, 25.5 M parameters,
    /// 4.2 G multiply-adds for an image of 224 x 224.
    pub(super) const RESNEXT50_32X4D: Self = Self {
        stem: 64,
        depths: [3, 4, 6, 3],
        groups: 32,
        group_width: 4,
        out: 256,
    };

    /// A quarter as wide and half as deep, 8 groups of 4 channels: 1.2 M parameters,
    /// 0.2 G multiply-adds for an image of 224 x 224.
    pub(super) const SMALL: Self = Self {
        stem: 16,
        depths: [1, 2, 3, 2],
        groups: 8,
        group_width: 4,
        out: 64,
    };

    /// The length of an embedding: the channels that leave the last stage.
    pub(super) const fn width(&self) -> usize {
        self.out << 3
    }

    /// The bottlenecks in order.
    pub(super) fn bottlenecks(&self) -> Vec<Bottleneck> {
        let mut input = self.stem;
        let mut bottlenecks = Vec::new();
        for (stage, &depth) in self.depths.iter().enumerate() {
            let out = self.out << stage;
            for index in 0..depth {
                bottlenecks.push(Bottleneck {
                    prefix: format!("layer{}.{index}", stage + 1),
                    input,
                    mid: (self.groups * self.group_width) << stage,
                    out,
                    groups: self.groups,
                    stride: if stage > 0 && index == 0 { 2 } else { 1 },
                    downsample: index == 0,
                });
                input = out;
            }
        }
        bottlenecks
    }
}

/// The ratio of the gate's input to its hidden layer.
const REDUCTION: usize = 16;

/// The stem's window.
const STEM: Window = Window::square(7, 2, 3);
/// The pooling after the stem, in ceil mode.
const POOL: Window = Window::square(3, 2, 0);

/// One bottleneck: its place in the network and its channels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Bottleneck {
    /// What its tensors' names begin with.
    pub(super) prefix: String,
    pub(super) input: usize,
    pub(super) mid: usize,
    pub(super) out: usize,
    pub(super) groups: usize,
    /// The stride of the 3x3 convolution and of the shortcut's.
    pub(super) stride: usize,
    /// Whether the shortcut has a convolution of its own.
    pub(super) downsample: bool,
}

impl Bottleneck {
    /// The name of one of its tensors or layers.
    pub(super) fn name(&self, leaf: &str) -> String {
        format!("{}.{leaf}", self.prefix)
    }

    /// Channels of the gate's hidden layer.
    pub(super) fn squeezed(&self) -> usize {
        self.out / REDUCTION
    }

    /// The first convolution.
    fn reduce(&self) -> ConvShape {
        point(self.input, self.mid, 1)
    }

    /// The second, in groups.
    fn grouped(&self) -> ConvShape {
        ConvShape {
            window: Window::square(3, self.stride, 1),
            inputs: self.mid,
            outputs: self.mid,
            groups: self.groups,
        }
    }

    /// The third.
    fn expand(&self) -> ConvShape {
        point(self.mid, self.out, 1)
    }

    /// The shortcut's, where it has one.
    fn shortcut(&self) -> ConvShape {
        point(self.input, self.out, self.stride)
    }
}

/// A 1x1 convolution.
const fn point(inputs: usize, outputs: usize, stride: usize) -> ConvShape {
    ConvShape {
        window: Window::square(1, stride, 0),
        inputs,
        outputs,
        groups: 1,
    }
}
