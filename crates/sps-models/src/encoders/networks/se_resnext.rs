//! Squeeze-and-excitation ResNeXt (Hu et al., "Squeeze-and-Excitation Networks", CVPR 2018), in
//! the layout of Cadene's and timm's `legacy_seresnext50_32x4d`.
//!
//! Four stages of bottlenecks, each a 1x1 convolution, a grouped 3x3 convolution, a 1x1
//! convolution and a squeeze-and-excitation gate on the residual branch. A stage halves height
//! and width (but for the first) and doubles both channel counts.

use super::super::network::{Conv, Gate, IMAGE, Map, Network, Slide};

/// The size of a squeeze-and-excitation ResNeXt.
struct Config {
    /// Channels of the 7x7 stem.
    stem: usize,
    /// Bottlenecks in each stage.
    depths: [usize; 4],
    /// Groups of the 3x3 convolutions.
    groups: usize,
    /// Channels of the 3x3 convolutions of the first stage.
    mid: usize,
    /// Channels that leave a bottleneck of the first stage.
    out: usize,
}

/// The ratio of the gate's input to its hidden layer.
const REDUCTION: usize = 16;

/// The paper's encoder: 50 layers, 32 groups of 4 channels, 25.5 M parameters, 4.2 G multiply-adds
/// for an image of 224 x 224.
pub(in crate::encoders) fn se_resnext50(name: &'static str) -> Network {
    let config = Config {
        stem: 64,
        depths: [3, 4, 6, 3],
        groups: 32,
        mid: 128,
        out: 256,
    };
    config.network(name)
}

/// A quarter as wide and half as deep, 8 groups of 4 channels: 1.2 M parameters, 0.2 G
/// multiply-adds for an image of 224 x 224.
pub(in crate::encoders) fn se_resnext_small(name: &'static str) -> Network {
    let config = Config {
        stem: 16,
        depths: [1, 2, 3, 2],
        groups: 8,
        mid: 32,
        out: 64,
    };
    config.network(name)
}

impl Config {
    fn network(&self, name: &'static str) -> Network {
        let mut net = Network::new(name, "last_linear.");
        let stem = Conv::new("layer0.conv1", Slide::square(7, 2, 3), self.stem);
        let mut x = net.conv(IMAGE, stem.norm("layer0.bn1").relu());
        x = net.max_pool(x, Slide::square(3, 2, 0), true);
        for (stage, depth) in self.depths.into_iter().enumerate() {
            for index in 0..depth {
                let stride = if stage > 0 && index == 0 { 2 } else { 1 };
                x = self.bottleneck(&mut net, x, stage, index, stride);
            }
            net.depth(format!("stage-{}", stage + 1));
        }
        net
    }

    fn bottleneck(
        &self,
        net: &mut Network,
        x: Map,
        stage: usize,
        index: usize,
        stride: usize,
    ) -> Map {
        let name = |leaf: &str| format!("layer{}.{index}.{leaf}", stage + 1);
        let (mid, out) = (self.mid << stage, self.out << stage);
        let point = |conv: &str, stride, outputs| {
            Conv::new(name(conv), Slide::square(1, stride, 0), outputs)
        };
        let shortcut = if index == 0 {
            let conv = point("downsample.0", stride, out);
            net.conv(x, conv.norm(name("downsample.1")))
        } else {
            x
        };
        let y = net.conv(x, point("conv1", 1, mid).norm(name("bn1")).relu());
        let grouped = Conv::new(name("conv2"), Slide::square(3, stride, 1), mid);
        let grouped = grouped.groups(self.groups).norm(name("bn2")).relu();
        let y = net.conv(y, grouped);
        let gate = Gate {
            layers: ["se_module.fc1", "se_module.fc2"].map(name),
            channels: out,
            hidden: out / REDUCTION,
        };
        let expand = point("conv3", 1, out).norm(name("bn3")).relu();
        net.residual(y, expand, Some(gate), shortcut)
    }
}
