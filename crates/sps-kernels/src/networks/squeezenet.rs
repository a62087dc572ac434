//! `SqueezeNet` (Iandola et al., 2016), in the layout of torchvision's `squeezenet1_0` and
//! `squeezenet1_1`.

use crate::network::{Conv, IMAGE, Map, Network, Slide};

/// A module: 1x1 to so many channels, then 1x1 and 3x3 to so many each.
type Fire = [usize; 2];

/// Version 1.0: a 7x7 stem of 96 channels.
pub fn squeezenet1_0(name: &'static str) -> Network {
    let modules: [&[Fire]; 3] = [
        &[[16, 64], [16, 64], [32, 128]],
        &[[32, 128], [48, 192], [48, 192], [64, 256]],
        &[[64, 256]],
    ];
    network(name, (7, 96), modules)
}

/// Version 1.1: a 3x3 stem of 64 channels, and pooling earlier, for 2.4 times fewer multiply-adds.
pub fn squeezenet1_1(name: &'static str) -> Network {
    let modules: [&[Fire]; 3] = [
        &[[16, 64], [16, 64]],
        &[[32, 128], [32, 128]],
        &[[48, 192], [48, 192], [64, 256], [64, 256]],
    ];
    network(name, (3, 64), modules)
}

/// A stem of such a window and so many channels, then modules with 3x3 max pooling before each group of them.
fn network(name: &'static str, (window, stem): (usize, usize), modules: [&[Fire]; 3]) -> Network {
    let mut net = Network::new(name, "classifier.1.");
    let stem = Conv::new("features.0", Slide::square(window, 2, 0), stem);
    let mut x = net.conv(IMAGE, stem.relu());
    // Layers are counted, the rectifier after the stem too.
    let (mut index, mut blocks) = (2, 0);
    for group in modules {
        x = net.max_pool(x, Slide::square(3, 2, 0), true);
        for &module in group {
            index += 1;
            blocks += 1;
            x = fire(&mut net, x, index, module);
            net.depth(format!("block-{blocks}"));
        }
        index += 1;
    }
    net
}

fn fire(net: &mut Network, x: Map, index: usize, [squeeze, expand]: Fire) -> Map {
    let conv = |leaf: &str, window: usize, outputs| {
        let slide = Slide::square(window, 1, window / 2);
        Conv::new(format!("features.{index}.{leaf}"), slide, outputs).relu()
    };
    let squeezed = net.conv(x, conv("squeeze", 1, squeeze));
    let point = conv("expand1x1", 1, expand);
    let square = conv("expand3x3", 3, expand);
    net.concat(vec![(squeezed, point), (squeezed, square)])
}
