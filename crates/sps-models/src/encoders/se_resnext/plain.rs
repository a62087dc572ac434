//! The network as a plain composition of candle's operators.

use candle_core::Tensor;

use super::{Bottleneck, SeResNextConfig};
use crate::encoders::plain::Plain;
use crate::error::Result;

/// Maps images `(n, 3, height, width)`, normalised, to the last feature map,
/// `(n, width, rows, columns)`.
pub(in crate::encoders) fn features(
    config: &SeResNextConfig,
    net: &Plain<'_>,
    images: &Tensor,
) -> Result<Tensor> {
    let mut x = net.conv(images, "layer0.conv1", 2, 3, 1)?;
    x = net.batch_norm(&x, "layer0.bn1")?.relu()?;
    x = net.max_pool(&x, 3, 2)?;
    for bottleneck in config.bottlenecks() {
        x = residual(&bottleneck, net, &x)?;
    }
    Ok(x)
}

fn residual(b: &Bottleneck, net: &Plain<'_>, x: &Tensor) -> Result<Tensor> {
    let mut y = net.conv(x, &b.name("conv1"), 1, 0, 1)?;
    y = net.batch_norm(&y, &b.name("bn1"))?.relu()?;
    y = net.conv(&y, &b.name("conv2"), b.stride, 1, b.groups)?;
    y = net.batch_norm(&y, &b.name("bn2"))?.relu()?;
    y = net.conv(&y, &b.name("conv3"), 1, 0, 1)?;
    y = net.batch_norm(&y, &b.name("bn3"))?;
    let shortcut = if b.downsample {
        let shortcut = net.conv(x, &b.name("downsample.0"), b.stride, 0, 1)?;
        net.batch_norm(&shortcut, &b.name("downsample.1"))?
    } else {
        x.clone()
    };
    Ok((y.broadcast_mul(&gate(b, net, &y)?)? + shortcut)?.relu()?)
}

/// Squeeze and excite: `(n, channels, h, w)` to a factor in (0, 1), `(n, channels, 1, 1)`.
fn gate(b: &Bottleneck, net: &Plain<'_>, y: &Tensor) -> Result<Tensor> {
    let squeezed = y.mean_keepdim((2, 3))?;
    let hidden = net
        .conv(&squeezed, &b.name("se_module.fc1"), 1, 0, 1)?
        .relu()?;
    let logits = net.conv(&hidden, &b.name("se_module.fc2"), 1, 0, 1)?;
    Ok(candle_nn::ops::sigmoid(&logits)?)
}
