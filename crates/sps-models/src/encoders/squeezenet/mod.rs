//! `SqueezeNet` 1.0 (Iandola et al., 2016), in the layout of torchvision's `squeezenet1_0`.

pub(super) mod fused;
pub(super) mod plain;

use crate::weights::TensorSpec;

/// Channels of the last feature map.
pub(super) const WIDTH: usize = 512;
/// The stem has a 7x7 window and no padding.
pub(super) const MIN_SIZE: usize = 7;

/// Channels of the 7x7 stem.
const STEM: usize = 96;

/// A step after the stem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// 3x3 max pooling, stride 2, ceil mode.
    Pool,
    /// `features.{index}`: 1x1 to `squeeze` channels, then 1x1 and 3x3 to `expand` each.
    Fire {
        index: usize,
        input: usize,
        squeeze: usize,
        expand: usize,
    },
}

const fn fire(index: usize, input: usize, squeeze: usize, expand: usize) -> Step {
    Step::Fire {
        index,
        input,
        squeeze,
        expand,
    }
}

const STEPS: [Step; 11] = [
    Step::Pool,
    fire(3, 96, 16, 64),
    fire(4, 128, 16, 64),
    fire(5, 128, 32, 128),
    Step::Pool,
    fire(7, 256, 32, 128),
    fire(8, 256, 48, 192),
    fire(9, 384, 48, 192),
    fire(10, 384, 64, 256),
    Step::Pool,
    fire(12, 512, 64, 256),
];

/// The tensors of the network.
pub(super) fn specs() -> Vec<TensorSpec> {
    let mut specs = Vec::new();
    let mut conv = |name: String, shape: &[usize]| {
        specs.push(TensorSpec::new(format!("{name}.weight"), shape));
        specs.push(TensorSpec::new(format!("{name}.bias"), &shape[..1]));
    };
    conv("features.0".to_owned(), &[STEM, 3, 7, 7]);
    for step in STEPS {
        if let Step::Fire {
            index,
            input,
            squeeze,
            expand,
        } = step
        {
            conv(format!("features.{index}.squeeze"), &[squeeze, input, 1, 1]);
            conv(
                format!("features.{index}.expand1x1"),
                &[expand, squeeze, 1, 1],
            );
            conv(
                format!("features.{index}.expand3x3"),
                &[expand, squeeze, 3, 3],
            );
        }
    }
    specs
}
