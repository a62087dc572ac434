//! Residual networks (He et al., "Deep Residual Learning for Image Recognition", CVPR 2016), in the
//! layout of torchvision's `resnet18` and `resnet50`: the stride of a bottleneck is that of its 3x3
//! convolution.

use crate::network::{Conv, IMAGE, Map, Network, Slide};

/// Channels of the stem and of the first stage's 3x3 convolutions; each stage has twice as many.
const CHANNELS: usize = 64;

/// Two 3x3 convolutions a block.
pub fn resnet18(name: &'static str) -> Network {
    network(name, [2; 4], 1, basic)
}

/// Bottlenecks of 1x1, 3x3 and 1x1 convolutions, the last to four times as many channels.
pub fn resnet50(name: &'static str) -> Network {
    network(name, [3, 4, 6, 3], 4, bottleneck)
}

/// The place of a block in the network.
struct Block {
    /// What its tensors' names begin with.
    prefix: String,
    /// Channels of its 3x3 convolutions.
    mid: usize,
    stride: usize,
}

impl Block {
    /// Batch norm `bn{n}` after convolution `conv{n}`, rectified.
    fn conv(&self, number: usize, slide: Slide, outputs: usize) -> Conv {
        let conv = Conv::new(format!("{}.conv{number}", self.prefix), slide, outputs);
        conv.norm(format!("{}.bn{number}", self.prefix)).relu()
    }

    /// The map that the branch is added to: the block's input, or a 1x1 convolution of it.
    fn shortcut(&self, net: &mut Network, x: Map, out: usize) -> Map {
        if self.stride == 1 && net.channels[x] == out {
            return x;
        }
        let slide = Slide::square(1, self.stride, 0);
        let conv = Conv::new(format!("{}.downsample.0", self.prefix), slide, out);
        net.conv(x, conv.norm(format!("{}.downsample.1", self.prefix)))
    }
}

/// Stages of such depths, whose blocks end in `wider` times the channels of their 3x3 convolutions.
fn network(
    name: &'static str,
    depths: [usize; 4],
    wider: usize,
    branch: fn(&mut Network, &Block, Map) -> (Map, Conv),
) -> Network {
    let mut net = Network::new(name, "fc.");
    let stem = Conv::new("conv1", Slide::square(7, 2, 3), CHANNELS);
    let mut x = net.conv(IMAGE, stem.norm("bn1").relu());
    x = net.max_pool(x, Slide::square(3, 2, 1), false);
    for (stage, depth) in depths.into_iter().enumerate() {
        for index in 0..depth {
            let block = Block {
                prefix: format!("layer{}.{index}", stage + 1),
                mid: CHANNELS << stage,
                stride: if stage > 0 && index == 0 { 2 } else { 1 },
            };
            let shortcut = block.shortcut(&mut net, x, wider * block.mid);
            let (inner, last) = branch(&mut net, &block, x);
            x = net.residual(inner, last, None, shortcut);
        }
        net.depth(format!("stage-{}", stage + 1));
    }
    net
}

/// The residual branch of two 3x3 convolutions: what enters the last, and the last.
fn basic(net: &mut Network, block: &Block, x: Map) -> (Map, Conv) {
    let first = block.conv(1, Slide::square(3, block.stride, 1), block.mid);
    let last = block.conv(2, Slide::square(3, 1, 1), block.mid);
    (net.conv(x, first), last)
}

/// The residual branch of a bottleneck: what enters its last convolution, and that.
fn bottleneck(net: &mut Network, block: &Block, x: Map) -> (Map, Conv) {
    let point = Slide::square(1, 1, 0);
    let y = net.conv(x, block.conv(1, point, block.mid));
    let square = block.conv(2, Slide::square(3, block.stride, 1), block.mid);
    (net.conv(y, square), block.conv(3, point, 4 * block.mid))
}
