//! Squeeze-and-excitation ResNeXt (Hu et al., "Squeeze-and-Excitation Networks", CVPR 2018), in
//! the layout of Cadene's and timm's `legacy_seresnext50_32x4d`.
//!
//! Four stages of bottlenecks, each a 1x1 convolution, a grouped 3x3 convolution, a 1x1
//! convolution and a squeeze-and-excitation gate on the residual branch. A stage halves height
//! and width (but for the first) and doubles both channel counts.

use crate::network::{Conv, Gate, IMAGE, Map, Network, Slide};

/// Bottlenecks in each stage.
const STAGES: [usize; 4] = [3, 4, 6, 3];

/// Channels of the 3x3 convolutions, and channels that leave a bottleneck, in the first stage.
const MID: usize = 128;
const OUT: usize = 256;

/// Groups of the 3x3 convolutions.
const GROUPS: usize = 32;

/// The ratio of the gate's input to its hidden layer.
const REDUCTION: usize = 16;

/// The paper's encoder: 50 layers, 32 groups of 4 channels, 25.5 M parameters, 4.2 G multiply-adds
/// for an image of 224 x 224.
pub fn se_resnext50(name: &'static str) -> Network {
    let mut net = Network::new(name, "last_linear.");
    let stem = Conv::new("layer0.conv1", Slide::square(7, 2, 3), 64);
    let mut x = net.conv(IMAGE, stem.norm("layer0.bn1").relu());
    x = net.max_pool(x, Slide::square(3, 2, 0), true);
    for (stage, blocks) in STAGES.into_iter().enumerate() {
        for index in 0..blocks {
            let stride = if stage > 0 && index == 0 { 2 } else { 1 };
            x = bottleneck(&mut net, x, stage, index, stride);
        }
        net.depth(format!("stage-{}", stage + 1));
    }
    net
}

fn bottleneck(net: &mut Network, x: Map, stage: usize, index: usize, stride: usize) -> Map {
    let name = |leaf: &str| format!("layer{}.{index}.{leaf}", stage + 1);
    let (mid, out) = (MID << stage, OUT << stage);
    let point =
        |conv: &str, stride, outputs| Conv::new(name(conv), Slide::square(1, stride, 0), outputs);
    let shortcut = if index == 0 {
        let conv = point("downsample.0", stride, out);
        net.conv(x, conv.norm(name("downsample.1")))
    } else {
        x
    };
    let y = net.conv(x, point("conv1", 1, mid).norm(name("bn1")).relu());
    let grouped = Conv::new(name("conv2"), Slide::square(3, stride, 1), mid);
    let grouped = grouped.groups(GROUPS).norm(name("bn2")).relu();
    let y = net.conv(y, grouped);
    let gate = Gate {
        layers: ["se_module.fc1", "se_module.fc2"].map(name),
        channels: out,
        hidden: out / REDUCTION,
    };
    let expand = point("conv3", 1, out).norm(name("bn3")).relu();
    net.residual(y, expand, Some(gate), shortcut)
}
