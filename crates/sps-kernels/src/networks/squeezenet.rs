//! `SqueezeNet` (Iandola et al., 2016), in the layout of torchvision's `squeezenet1_0` and
//! `squeezenet1_1`.

use crate::network::{Conv, IMAGE, Map, Network, Slide};

/// A module after the stem.
enum Module {
    /// 3x3 max pooling, stride 2, ceil mode.
    Pool,
    /// 1x1 to so many channels, then 1x1 and 3x3 to as many each.
    Fire(usize, usize),
}

use Module::{Fire, Pool};

/// Version 1.0: a 7x7 stem of 96 channels.
pub fn squeezenet1_0(name: &'static str) -> Network {
    let modules = [
        Pool,
        Fire(16, 64),
        Fire(16, 64),
        Fire(32, 128),
        Pool,
        Fire(32, 128),
        Fire(48, 192),
        Fire(48, 192),
        Fire(64, 256),
        Pool,
        Fire(64, 256),
    ];
    network(name, (7, 96), &modules)
}

/// Version 1.1: a 3x3 stem of 64 channels, and pooling earlier, for 2.4 times fewer multiply-adds.
pub fn squeezenet1_1(name: &'static str) -> Network {
    let modules = [
        Pool,
        Fire(16, 64),
        Fire(16, 64),
        Pool,
        Fire(32, 128),
        Fire(32, 128),
        Pool,
        Fire(48, 192),
        Fire(48, 192),
        Fire(64, 256),
        Fire(64, 256),
    ];
    network(name, (3, 64), &modules)
}

/// After a stem of such a window and so many channels.
fn network(name: &'static str, (window, stem): (usize, usize), modules: &[Module]) -> Network {
    let mut net = Network::new(name, "classifier.1.");
    let stem = Conv::new("features.0", Slide::square(window, 2, 0), stem);
    let mut x = net.conv(IMAGE, stem.relu());
    let mut blocks = 0;
    // The rectifier after the stem is counted too.
    for (index, module) in (2..).zip(modules) {
        x = match *module {
            Pool => net.max_pool(x, Slide::square(3, 2, 0), true),
            Fire(squeeze, expand) => {
                let x = fire(&mut net, x, index, squeeze, expand);
                blocks += 1;
                net.depth(format!("block-{blocks}"));
                x
            }
        };
    }
    net
}

fn fire(net: &mut Network, x: Map, index: usize, squeeze: usize, expand: usize) -> Map {
    let conv = |leaf: &str, window: usize, outputs| {
        let slide = Slide::square(window, 1, window / 2);
        Conv::new(format!("features.{index}.{leaf}"), slide, outputs).relu()
    };
    let squeezed = net.conv(x, conv("squeeze", 1, squeeze));
    let point = conv("expand1x1", 1, expand);
    let square = conv("expand3x3", 3, expand);
    net.concat(vec![(squeezed, point), (squeezed, square)])
}
