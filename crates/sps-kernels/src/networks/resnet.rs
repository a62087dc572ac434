//! Residual networks (He et al., "Deep Residual Learning for Image Recognition", CVPR 2016), in the
//! layout of torchvision's `resnet18` and `resnet50`: the stride of a bottleneck is that of its 3x3
//! convolution. And squeeze-and-excitation `ResNeXt` (Hu et al., "Squeeze-and-Excitation Networks", CVPR
//! 2018), in the layout of Cadene's and timm's `legacy_seresnext50_32x4d`, whose bottlenecks have a grouped
//! 3x3 convolution and a gate on the residual branch.

use crate::network::{Conv, Gate, IMAGE, Map, Network, Slide};

/// Channels of the stem.
const STEM: usize = 64;

/// The map that the stem makes.
const STEM_MAP: Map = IMAGE + 1;

/// Groups of a `ResNeXt`'s 3x3 convolutions.
const GROUPS: usize = 32;

/// The ratio of a gate's input to its hidden layer.
const REDUCTION: usize = 16;

/// Two 3x3 convolutions a block.
pub fn resnet18(name: &'static str) -> Network {
    let mut net = stem(name, "fc.", "");
    net.max_pool(STEM_MAP, Slide::square(3, 2, 1), false);
    stages(net, [2; 4], [64, 64], basic)
}

/// Bottlenecks of 1x1, 3x3 and 1x1 convolutions, the last to four times as many channels.
pub fn resnet50(name: &'static str) -> Network {
    let mut net = stem(name, "fc.", "");
    net.max_pool(STEM_MAP, Slide::square(3, 2, 1), false);
    stages(net, [3, 4, 6, 3], [64, 256], |net, block, x| {
        (bottleneck(net, block, 1, x), None)
    })
}

/// The paper's encoder: 50 layers, 32 groups of 4 channels, 25.5 M parameters, 4.2 G multiply-adds
/// for an image of 224 x 224.
pub fn se_resnext50(name: &'static str) -> Network {
    let mut net = stem(name, "last_linear.", "layer0.");
    net.max_pool(STEM_MAP, Slide::square(3, 2, 0), true);
    stages(net, [3, 4, 6, 3], [128, 256], |net, block, x| {
        let gate = Gate {
            layers: ["se_module.fc1", "se_module.fc2"].map(|leaf| block.name(leaf)),
            channels: block.out,
            hidden: block.out / REDUCTION,
        };
        (bottleneck(net, block, GROUPS, x), Some(gate))
    })
}

/// The place of a block in the network.
struct Block {
    /// What its tensors' names begin with.
    prefix: String,
    /// Channels of its 3x3 convolutions, and those that leave it.
    mid: usize,
    out: usize,
    stride: usize,
}

/// What enters the last convolution of a residual branch, and that.
type Branch = (Map, Conv);

impl Block {
    fn name(&self, leaf: &str) -> String {
        format!("{}.{leaf}", self.prefix)
    }

    /// Batch norm `bn{n}` after convolution `conv{n}`, rectified.
    fn conv(&self, number: usize, slide: Slide, outputs: usize) -> Conv {
        let conv = Conv::new(self.name(&format!("conv{number}")), slide, outputs);
        conv.norm(self.name(&format!("bn{number}"))).relu()
    }

    /// The map that the branch is added to: the block's input, or a 1x1 convolution of it.
    fn shortcut(&self, net: &mut Network, x: Map) -> Map {
        if self.stride == 1 && net.channels[x] == self.out {
            return x;
        }
        let slide = Slide::square(1, self.stride, 0);
        let conv = Conv::new(self.name("downsample.0"), slide, self.out);
        net.conv(x, conv.norm(self.name("downsample.1")))
    }
}

/// A network of a 7x7 convolution.
fn stem(name: &'static str, classifier: &'static str, prefix: &str) -> Network {
    let mut net = Network::new(name, classifier);
    let stem = Conv::new(format!("{prefix}conv1"), Slide::square(7, 2, 3), STEM);
    net.conv(IMAGE, stem.norm(format!("{prefix}bn1")).relu());
    net
}

/// Adds stages of so many blocks each. `channels` are `mid` and `out` of the first stage's blocks; each stage has twice
/// as many as the one before.
fn stages(
    mut net: Network,
    depths: [usize; 4],
    channels: [usize; 2],
    branch: fn(&mut Network, &Block, Map) -> (Branch, Option<Gate>),
) -> Network {
    let mut x = net.layers.len();
    for (stage, depth) in depths.into_iter().enumerate() {
        let [mid, out] = channels.map(|channels| channels << stage);
        for index in 0..depth {
            let block = Block {
                prefix: format!("layer{}.{index}", stage + 1),
                mid,
                out,
                stride: if stage > 0 && index == 0 { 2 } else { 1 },
            };
            let shortcut = block.shortcut(&mut net, x);
            let ((inner, last), gate) = branch(&mut net, &block, x);
            x = net.residual(inner, last, gate, shortcut);
        }
        net.depth(format!("stage-{}", stage + 1));
    }
    net
}

/// Two 3x3 convolutions.
fn basic(net: &mut Network, block: &Block, x: Map) -> (Branch, Option<Gate>) {
    let first = block.conv(1, Slide::square(3, block.stride, 1), block.mid);
    let last = block.conv(2, Slide::square(3, 1, 1), block.mid);
    ((net.conv(x, first), last), None)
}

/// A 1x1 convolution, a 3x3 one in so many groups and a 1x1 one.
fn bottleneck(net: &mut Network, block: &Block, groups: usize, x: Map) -> Branch {
    let point = Slide::square(1, 1, 0);
    let y = net.conv(x, block.conv(1, point, block.mid));
    let square = block.conv(2, Slide::square(3, block.stride, 1), block.mid);
    let y = net.conv(y, square.groups(groups));
    (y, block.conv(3, point, block.out))
}
