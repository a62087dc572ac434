//! Images that a network takes, and those that it refuses.

use candle_core::{DType, Tensor};
use sps_kernels::Size;
use sps_kernels::network::Network;

use crate::error::{Error, Result};

/// The extents of images of so many rows and columns. Refuses no image, images that do not fill their
/// size, sizes that the network does not take, and sequences of different lengths.
pub(super) fn check_pixels(
    network: &Network,
    images: &[&[f32]],
    [height, width]: [usize; 2],
) -> Result<Size> {
    let min = network.min_size();
    let frame = height.checked_mul(width).and_then(|n| n.checked_mul(3));
    let first = images.first().map_or(0, |image| image.len());
    let frames = match frame {
        Some(frame) if network.sequences => first.checked_div(frame).unwrap_or(0),
        _ => 1,
    };
    let len = frame.and_then(|frame| frame.checked_mul(frames));
    let misfit = images.iter().find(|image| Some(image.len()) != len);
    if first == 0 || misfit.is_some() || height.min(width) < min {
        let values = misfit.map_or(first, |image| image.len());
        let (count, size) = (images.len(), [height, width]);
        let found = format_args!("{count} images, one of {values} values for {size:?}");
        let expected = format_args!("images of three values a pixel, sides of at least {min}");
        return Err(Error::input("pixels", found, expected));
    }
    Ok([frames, height, width])
}

/// The extents of the images of a batch. Refuses what the network does not take.
pub(super) fn check(network: &Network, images: &Tensor) -> Result<Size> {
    let min = network.min_size();
    let size = match *images.dims() {
        [_, 3, height, width] if !network.sequences => [1, height, width],
        [_, 3, frames, height, width] if network.sequences => [frames, height, width],
        _ => [0; 3],
    };
    let fits = images.elem_count() > 0 && size[1].min(size[2]) >= min;
    if !fits || images.dtype() != DType::F32 {
        let frames = if network.sequences { "frames, " } else { "" };
        let found = format_args!("{:?} of {:?}", images.dims(), images.dtype());
        let expected = format!(
            "(n, 3, {frames}height, width) of F32, none of them 0, sides of at least {min}"
        );
        return Err(Error::input("images", found, expected));
    }
    // The kernels have no gradient for images; one that is asked for is not left out silently.
    if images.track_op() {
        let found = "a variable, or computed from one";
        let expected = "constants: `Tensor::detach` gives them";
        return Err(Error::input("images", found, expected));
    }
    Ok(size)
}
