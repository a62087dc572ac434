//! Images as the kernels take them.

use std::ops::Range;

use super::batch::Images;
use super::scales::Scale;
use crate::ops::bands::{Threads, for_each_band};
use crate::ops::grid::Grid;
use crate::ops::image::rows_of_words;
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

/// Where the channels of an image in memory are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    /// A plane for each.
    Planes,
    /// Those of a pixel together.
    Pixels,
}

/// Lays one of the images out as `grid` says of a single frame and [`crate::ops::image`] of its rows; around it
/// lies `zero`.
pub(super) fn lay_out<W: Word>(
    threads: Threads,
    image: &[f32],
    images: &Images<'_>,
    (out, grid): (&mut [W], &Grid),
    zero: f32,
) {
    let memory = rows_of_words::<W>(grid);
    memory.fill_border(out, W::of(|_| zero));
    for_each_band(threads, &memory, out, |band| {
        let rows = band.rows(&memory);
        let target = (band.target, band.origin);
        lay_out_rows(image, images, grid, rows, target, zero);
    });
}

/// The same for some rows, into memory that begins at `origin`.
fn lay_out_rows<W: Word>(
    image: &[f32],
    images: &Images<'_>,
    grid: &Grid,
    rows: Range<usize>,
    (out, origin): (&mut [W], usize),
    zero: f32,
) {
    let [time, height, width] = grid.size;
    let memory = rows_of_words::<W>(grid);
    let words = memory.size[2];
    let plane = time * height * width;
    // Of each number of a row, so that a vector of them is normalised at once.
    let Normalisation { mean, std } = images.normalisation;
    let (means, stds) = (mean.repeat(width), std.repeat(width));
    let mut numbers = vec![zero; W::NUMBERS * words];
    for row in rows {
        let pixels = &mut numbers[3 * grid.before[2]..][..3 * width];
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
            memory.before[0] + row / height,
            memory.before[1] + row % height,
            0,
        ];
        let out = &mut out[memory.index(0, place) - origin..][..words];
        for (word, numbers) in out.iter_mut().zip(numbers.chunks_exact(W::NUMBERS)) {
            *word = W::of(|i| numbers[i]);
        }
    }
}
