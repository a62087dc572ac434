//! Inflated Inception-v1, I3D (Carreira and Zisserman, "Quo Vadis, Action Recognition?", CVPR
//! 2017), with the tensor names of the widely used port to PyTorch (`pytorch-i3d`).

use crate::images::Normalisation;
use crate::network::{Conv, IMAGE, Map, Network, Slide};

/// A layer, or layers side by side, as the authors number them. The stride alone decides the extents.
enum Endpoint {
    /// Convolution, batch norm and rectifier: name, channels, window, stride.
    Unit(&'static str, usize, usize, usize),
    /// Max pooling: window and stride.
    Pool([usize; 3], [usize; 3]),
    /// Four branches side by side: name, channels of the six units.
    Mixed(&'static str, [usize; 6]),
}

const ENDPOINTS: [Endpoint; 16] = [
    Endpoint::Unit("Conv3d_1a_7x7", 64, 7, 2),
    Endpoint::Pool([1, 3, 3], [1, 2, 2]),
    Endpoint::Unit("Conv3d_2b_1x1", 64, 1, 1),
    Endpoint::Unit("Conv3d_2c_3x3", 192, 3, 1),
    Endpoint::Pool([1, 3, 3], [1, 2, 2]),
    Endpoint::Mixed("Mixed_3b", [64, 96, 128, 16, 32, 32]),
    Endpoint::Mixed("Mixed_3c", [128, 128, 192, 32, 96, 64]),
    Endpoint::Pool([3; 3], [2; 3]),
    Endpoint::Mixed("Mixed_4b", [192, 96, 208, 16, 48, 64]),
    Endpoint::Mixed("Mixed_4c", [160, 112, 224, 24, 64, 64]),
    Endpoint::Mixed("Mixed_4d", [128, 128, 256, 24, 64, 64]),
    Endpoint::Mixed("Mixed_4e", [112, 144, 288, 32, 64, 64]),
    Endpoint::Mixed("Mixed_4f", [256, 160, 320, 32, 128, 128]),
    Endpoint::Pool([2; 3], [2; 3]),
    Endpoint::Mixed("Mixed_5b", [256, 160, 320, 32, 128, 128]),
    Endpoint::Mixed("Mixed_5c", [384, 192, 384, 48, 128, 128]),
];

/// Takes values in -1..=1, sequences of any number of frames.
pub fn i3d(name: &'static str) -> Network {
    let mut net = Network::new(name, "logits.");
    net.normalisation = Normalisation {
        mean: [0.5; 3],
        std: [0.5; 3],
    };
    net.eps = 1e-3;
    net.sequences = true;
    let (mut x, mut blocks) = (IMAGE, 0);
    for endpoint in ENDPOINTS {
        x = match endpoint {
            Endpoint::Unit(name, outputs, size, stride) => {
                net.conv(x, unit(name, size, stride, outputs))
            }
            Endpoint::Pool(size, stride) => net.max_pool(x, Slide::Same { size, stride }, false),
            Endpoint::Mixed(name, outputs) => {
                let x = mixed(&mut net, x, name, outputs);
                blocks += 1;
                net.depth(format!("block-{blocks}"));
                x
            }
        };
    }
    net
}

fn unit(name: &str, size: usize, stride: usize, outputs: usize) -> Conv {
    let [size, stride] = [size, stride].map(|extent| [extent; 3]);
    let conv = Conv::new(
        format!("{name}.conv3d"),
        Slide::Same { size, stride },
        outputs,
    );
    conv.norm(format!("{name}.bn")).relu()
}

/// A 1x1 convolution, two of which a 3x3 convolution reads, and one of the pooled map.
fn mixed(net: &mut Network, x: Map, name: &str, outputs: [usize; 6]) -> Map {
    let unit = |branch: &str, size, outputs| unit(&format!("{name}.{branch}"), size, 1, outputs);
    let [b0, b1a, b1b, b2a, b2b, b3b] = outputs;
    let first = net.conv(x, unit("b1a", 1, b1a));
    let second = net.conv(x, unit("b2a", 1, b2a));
    let slide = Slide::Same {
        size: [3; 3],
        stride: [1; 3],
    };
    let pooled = net.max_pool(x, slide, false);
    net.concat(vec![
        (x, unit("b0", 1, b0)),
        (first, unit("b1b", 3, b1b)),
        (second, unit("b2b", 3, b2b)),
        (pooled, unit("b3b", 1, b3b)),
    ])
}
