//! Images as the kernels take them.

use std::ops::Range;

use super::batch::Images;
use crate::ops::bands::{Threads, for_each_band};
use crate::ops::format::{Format, pair};
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

/// Lays one of the images out channels last, as `grid` says of a single frame.
pub(super) fn lay_out(
    threads: Threads,
    image: &[f32],
    images: &Images<'_>,
    grid: &Grid,
    out: &mut [f32],
) {
    let width = grid.size[2].max(1);
    for_each_band(threads, grid, out, |band| {
        let rows = band.pixels.start / width..band.pixels.end / width;
        lay_out_rows(image, images, grid, rows, (band.target, band.origin));
    });
}

/// The same for some rows, into memory that begins at `origin`.
fn lay_out_rows(
    image: &[f32],
    images: &Images<'_>,
    grid: &Grid,
    rows: Range<usize>,
    (out, origin): (&mut [f32], usize),
) {
    let [time, height, width] = grid.size;
    let plane = time * height * width;
    // Of each number of a row, so that a vector of them is normalised at once.
    let Normalisation { mean, std } = images.normalisation;
    let (means, stds) = (mean.repeat(width), std.repeat(width));
    let mut pixels = vec![0.0; 3 * width];
    for row in rows {
        match images.order {
            Order::Planes => {
                for channel in 0..3 {
                    let values = &image[channel * plane + row * width..][..width];
                    for (pixel, value) in pixels.chunks_exact_mut(3).zip(values) {
                        pixel[channel] = *value;
                    }
                }
            }
            Order::Pixels => pixels.copy_from_slice(&image[3 * row * width..][..3 * width]),
        }
        for ((value, mean), std) in pixels.iter_mut().zip(&means).zip(&stds) {
            *value = (*value - mean) / std;
        }
        let place = [
            grid.before[0] + row / height,
            grid.before[1] + row % height,
            grid.before[2],
        ];
        let out = &mut out[grid.index(0, place) - origin..][..width * grid.pitch];
        match grid.format {
            Format::F32 => out.copy_from_slice(&pixels),
            Format::Bf16 => {
                for (words, pixel) in out.chunks_exact_mut(2).zip(pixels.chunks_exact(3)) {
                    words[0] = pair(pixel[0], pixel[1]);
                    words[1] = pair(pixel[2], 0.0);
                }
            }
        }
    }
}
