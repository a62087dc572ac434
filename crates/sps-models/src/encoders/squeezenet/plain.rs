//! The network as a plain composition of candle's operators.

use candle_core::Tensor;

use super::{MODULES, Module};
use crate::encoders::plain::Plain;
use crate::error::Result;

/// Maps images `(n, 3, height, width)`, normalised, to the last feature map,
/// `(n, 512, rows, columns)`.
pub(in crate::encoders) fn features(net: &Plain<'_>, images: &Tensor) -> Result<Tensor> {
    let mut x = net.conv(images, "features.0", 2, 0, 1)?.relu()?;
    for module in MODULES {
        x = match module {
            Module::Pool => net.max_pool(&x, 3, 2)?,
            Module::Fire { index, .. } => {
                let layer = |leaf: &str| format!("features.{index}.{leaf}");
                let squeezed = net.conv(&x, &layer("squeeze"), 1, 0, 1)?.relu()?;
                let left = net.conv(&squeezed, &layer("expand1x1"), 1, 0, 1)?;
                let right = net.conv(&squeezed, &layer("expand3x3"), 1, 1, 1)?;
                Tensor::cat(&[left, right], 1)?.relu()?
            }
        };
    }
    Ok(x)
}
