//! `SqueezeNet` 1.0 (Iandola et al., 2016), in the layout of torchvision's `squeezenet1_0`.

pub(super) mod fused;
pub(super) mod plain;

use crate::ops::Window;
use crate::ops::conv::ConvShape;
use crate::ops::grid::Size;
use crate::weights::TensorSpec;

/// Channels of the last feature map.
pub(super) const WIDTH: usize = 512;
/// The stem has a 7x7 window and no padding.
pub(super) const MIN_SIZE: usize = 7;

/// Channels of the 7x7 stem.
const STEM: usize = 96;
/// The windows of the stem, of the pooling (in ceil mode), and of the two kinds of layer.
const STEM_WINDOW: Window = Window::square(7, 2, 0);
const POOL: Window = Window::square(3, 2, 0);
const POINT: Window = Window::square(1, 1, 0);
const SQUARE: Window = Window::square(3, 1, 1);

/// A module after the stem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Module {
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

const fn fire(index: usize, input: usize, squeeze: usize, expand: usize) -> Module {
    Module::Fire {
        index,
        input,
        squeeze,
        expand,
    }
}

const MODULES: [Module; 11] = [
    Module::Pool,
    fire(3, 96, 16, 64),
    fire(4, 128, 16, 64),
    fire(5, 128, 32, 128),
    Module::Pool,
    fire(7, 256, 32, 128),
    fire(8, 256, 48, 192),
    fire(9, 384, 48, 192),
    fire(10, 384, 64, 256),
    Module::Pool,
    fire(12, 512, 64, 256),
];

/// Multiply-adds for one image of so many pixels.
pub(super) fn multiply_adds(size: Size) -> Option<u64> {
    let layer = |window, inputs, outputs, size| {
        let shape = ConvShape {
            window,
            inputs,
            outputs,
            groups: 1,
        };
        shape.multiply_adds(size)
    };
    let mut count = layer(STEM_WINDOW, 3, STEM, size)?;
    let mut size = STEM_WINDOW.output(size)?;
    for module in MODULES {
        match module {
            Module::Pool => size = POOL.output_ceil(size),
            Module::Fire {
                input,
                squeeze,
                expand,
                ..
            } => {
                count += layer(POINT, input, squeeze, size)?;
                count += layer(POINT, squeeze, expand, size)?;
                count += layer(SQUARE, squeeze, expand, size)?;
            }
        }
    }
    Some(count)
}

/// The tensors of the network.
pub(super) fn specs() -> Vec<TensorSpec> {
    let mut specs = Vec::new();
    let mut conv = |name: String, shape: &[usize]| {
        specs.push(TensorSpec::new(format!("{name}.weight"), shape));
        specs.push(TensorSpec::new(format!("{name}.bias"), &shape[..1]));
    };
    conv("features.0".to_owned(), &[STEM, 3, 7, 7]);
    for module in MODULES {
        if let Module::Fire {
            index,
            input,
            squeeze,
            expand,
        } = module
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
