//! Images as the kernels take them.

use std::ops::Range;

use super::batch::Images;
use super::scales::Scale;
use crate::ops::bands::{Threads, for_each_band};
use crate::ops::grid::Grid;
use crate::ops::words::Word;

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

    /// To the numbers of a map.
    pub(super) fn scaled(&self, scale: Scale) -> Self {
        let std = self.std.map(|std| std * scale.step);
        let mean = [0, 1, 2].map(|channel| self.mean[channel] - scale.zero * std[channel]);
        Self { mean, std }
    }
}

/// Channels of an image for the kernels: those of bf16 and int8 are four, of which the last counts for
/// nothing, so that a pixel fills whole words.
pub(super) fn image_channels<W: Word>() -> usize {
    3_usize.next_multiple_of(W::NUMBERS)
}

/// The weights `(outputs, 3, taps)` of a convolution of images, for their channels in memory.
pub(super) fn image_weights<W: Word>(weights: &[f32], taps: usize) -> Vec<f32> {
    let nothing = vec![0.0; (image_channels::<W>() - 3) * taps];
    let outputs = weights.chunks_exact(3 * taps);
    outputs
        .flat_map(|output| output.iter().chain(&nothing).copied())
        .collect()
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
pub(super) fn lay_out<W: Word>(
    threads: Threads,
    image: &[f32],
    images: &Images<'_>,
    grid: &Grid,
    out: &mut [W],
) {
    let width = grid.size[2].max(1);
    for_each_band(threads, grid, out, |band| {
        let rows = band.pixels.start / width..band.pixels.end / width;
        lay_out_rows(image, images, grid, rows, (band.target, band.origin));
    });
}

/// The same for some rows, into memory that begins at `origin`.
fn lay_out_rows<W: Word>(
    image: &[f32],
    images: &Images<'_>,
    grid: &Grid,
    rows: Range<usize>,
    (out, origin): (&mut [W], usize),
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
        let words = out.chunks_exact_mut(W::words(3));
        for (words, pixel) in words.zip(pixels.chunks_exact(3)) {
            for (word, first) in words.iter_mut().zip((0..3).step_by(W::NUMBERS)) {
                *word = W::of(|i| pixel.get(first + i).copied().unwrap_or_default());
            }
        }
    }
}
