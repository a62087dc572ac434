//! Images as the kernels take them.

use half::bf16;

use super::batch::Images;
use crate::ops::format::Format;
use crate::ops::grid::{Grid, Size};

/// What a network takes out of its input: `(value - mean) / std` of each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Normalisation {
    pub(super) mean: [f32; 3],
    pub(super) std: [f32; 3],
}

impl Normalisation {
    /// ImageNet's, which torchvision's and timm's networks expect.
    pub(super) const IMAGENET: Self = Self {
        mean: [0.485, 0.456, 0.406],
        std: [0.229, 0.224, 0.225],
    };
    /// Of values that are normalised already.
    pub(super) const NONE: Self = Self {
        mean: [0.0; 3],
        std: [1.0; 3],
    };
}

/// The layout of one image for the kernels. A pixel of bf16 has a fourth channel, which is zero, so
/// that it fills whole words.
pub(super) fn image_grid(size: Size, format: Format) -> Grid {
    let channels = match format {
        Format::F32 => 3,
        Format::Bf16 => 4,
    };
    Grid::tight(1, size, channels).in_format(format)
}

/// Where the channels of an image in memory are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    /// A plane for each.
    Planes,
    /// Those of a pixel together.
    Pixels,
}

/// Lays one of the images out channels last inside the first frame of `grid`.
pub(super) fn lay_out(image: &[f32], images: &Images<'_>, grid: &Grid, out: &mut [f32]) {
    let normalisation = images.normalisation;
    let [time, height, width] = grid.size;
    let plane = time * height * width;
    for row in 0..time * height {
        let place = [
            grid.before[0] + row / height,
            grid.before[1] + row % height,
            grid.before[2],
        ];
        let start = grid.index(0, place);
        let out = &mut out[start..start + width * grid.pitch];
        if grid.format == Format::Bf16 {
            out.fill(0.0);
        }
        for channel in 0..3 {
            let (mean, std) = (normalisation.mean[channel], normalisation.std[channel]);
            let (from, step) = match images.order {
                Order::Planes => (channel * plane + row * width, 1),
                Order::Pixels => (row * width * 3 + channel, 3),
            };
            let values = image[from..].iter().step_by(step).take(width);
            let values = values.map(|value| (value - mean) / std);
            match grid.format {
                Format::F32 => {
                    for (pixel, value) in out.chunks_exact_mut(3).zip(values) {
                        pixel[channel] = value;
                    }
                }
                Format::Bf16 => {
                    let out: &mut [bf16] = bytemuck::cast_slice_mut(out);
                    for (pixel, value) in out.chunks_exact_mut(4).zip(values) {
                        pixel[channel] = bf16::from_f32(value);
                    }
                }
            }
        }
    }
}
