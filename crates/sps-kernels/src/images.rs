//! Images as the kernels take them.

use crate::error::{Error, Result};
use crate::inference::Scale;
use crate::ops::bands::{Band, Threads, for_each_band};
use crate::ops::grid::{Grid, Size};
use crate::ops::image::{CELL, Layout, PIXEL};
use crate::ops::simd::{Kernel, Lanes, Level};
use crate::ops::words::Word;

/// What a network takes out of its input: `(value - mean) / std` of each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normalisation {
    /// Of red, green and blue.
    pub mean: [f32; 3],
    /// Of red, green and blue.
    pub std: [f32; 3],
}

impl Normalisation {
    /// ImageNet's, which torchvision's and timm's networks expect.
    pub const IMAGENET: Self = Self {
        mean: [0.485, 0.456, 0.406],
        std: [0.229, 0.224, 0.225],
    };
    /// Of values that are normalised already.
    pub const NONE: Self = Self {
        mean: [0.0; 3],
        std: [1.0; 3],
    };

    /// To the numbers of a map.
    pub(crate) fn scaled(&self, scale: Scale) -> Self {
        let std = self.std.map(|std| std * scale.step);
        let mean = [0, 1, 2].map(|channel| self.mean[channel] - scale.zero * std[channel]);
        Self { mean, std }
    }
}

/// Where the channels of an image in memory are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// A plane for each.
    Planes,
    /// Those of a pixel together.
    Pixels,
}

/// Images, or sequences of frames, and what is taken out of them.
#[derive(Debug, Clone, Copy)]
pub struct Images<'a> {
    pub(crate) pixels: &'a [&'a [f32]],
    pub(crate) order: Order,
    pub(crate) size: Size,
    pub(crate) normalisation: Normalisation,
}

impl<'a> Images<'a> {
    /// Takes images of one size (frames, one but for a sequence; rows; columns), each `(3, ..size)` or
    /// `(..size, 3)` row-major.
    ///
    /// # Errors
    /// No image, one that does not fill its size, a size with a 0.
    pub fn new(
        pixels: &'a [&'a [f32]],
        order: Order,
        size: Size,
        normalisation: Normalisation,
    ) -> Result<Self> {
        let len = size.into_iter().try_fold(3, usize::checked_mul);
        let misfit = pixels.iter().find(|image| Some(image.len()) != len);
        if pixels.is_empty() || misfit.is_some() || size.contains(&0) {
            let values = misfit.or(pixels.first()).map_or(0, |image| image.len());
            let images = pixels.len();
            let found = format_args!("{images} images, one of {values} values for {size:?}");
            return Err(Error::input("images", found, "three values a pixel"));
        }
        Ok(Self {
            pixels,
            order,
            size,
            normalisation,
        })
    }

    /// The images of a batch `(images, 3, ..size)` or `(images, ..size, 3)` that lies in memory as a whole.
    pub fn each(values: &[f32], size: Size) -> Vec<&[f32]> {
        let len = 3 * size.iter().product::<usize>();
        values.chunks_exact(len.max(1)).collect()
    }

    pub(crate) fn frames(&self) -> usize {
        self.pixels.len()
    }

    /// The images one by one.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &'a [f32]> {
        self.pixels.iter().copied()
    }

    pub(crate) fn split_at(self, frames: usize) -> (Self, Self) {
        let (left, right) = self.pixels.split_at(frames);
        let with = |pixels| Self { pixels, ..self };
        (with(left), with(right))
    }

    pub(crate) fn chunks(self, frames: usize) -> impl Iterator<Item = Self> {
        let chunks = self.pixels.chunks(frames);
        chunks.map(move |pixels| Self { pixels, ..self })
    }
}

/// Lays one of the images out, scaled, as `grid` says of a single frame and `layout` of its pixels; around it lies what
/// stands for 0.
pub(crate) fn lay_out<W: Word>(
    (threads, level): (Threads, Level),
    image: &[f32],
    images: &Images<'_>,
    (out, grid, layout): (&mut [W], &Grid, Layout),
    scale: Scale,
) {
    let memory = layout.memory::<W>(grid);
    memory.fill_border(out, W::of(|_| scale.zero));
    for_each_band(threads, &memory, out, |band| {
        level.run(LayOut {
            image,
            images,
            grid,
            layout,
            band,
            scale,
        });
    });
}

/// The same for some rows.
struct LayOut<'a, 'b, W> {
    image: &'a [f32],
    images: &'a Images<'a>,
    grid: &'a Grid,
    layout: Layout,
    band: Band<'b, W>,
    scale: Scale,
}

impl<W: Word> Kernel for LayOut<'_, '_, W> {
    type Output = ();

    // As in `ops`.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn run<S: Lanes>(mut self, _: S) {
        let target = std::mem::take(&mut self.band.target);
        let memory = self.layout.memory::<W>(self.grid);
        let words = memory.size[2] * memory.pitch;
        let height = self.grid.size[1];
        let mut numbers = vec![self.scale.zero; W::NUMBERS * words];
        // A row of the image, of which a row of cells has two.
        let mut line = vec![W::default(); words.div_ceil(CELL)];
        for row in self.band.rows(&memory) {
            let first = memory.row_start(row) - self.band.origin;
            let out = &mut target[first..][..words];
            if self.layout == Layout::Rows {
                self.write(row, &mut numbers, out);
                continue;
            }
            let (time, row) = (row / memory.size[1], row % memory.size[1]);
            for within in 0..CELL {
                let inside = (CELL * row + within).checked_sub(self.grid.before[1]);
                if let Some(row) = inside.filter(|row| *row < height) {
                    self.write(time * height + row, &mut numbers, &mut line);
                } else {
                    line.fill(W::of(|_| self.scale.zero));
                }
                let (parts, _) = W::each(&line).as_chunks::<{ CELL * PIXEL }>();
                let (places, _) = W::each_mut(out).as_chunks_mut::<{ CELL * PIXEL }>();
                let places = places.iter_mut().skip(within).step_by(CELL);
                for (place, part) in places.zip(parts) {
                    *place = *part;
                }
            }
        }
    }
}

impl<W: Word> LayOut<'_, '_, W> {
    /// Writes a row of the image with the padding beside it, by way of its numbers.
    // As in `ops`.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn write(&self, row: usize, numbers: &mut [f32], out: &mut [W]) {
        let [time, height, width] = self.grid.size;
        let plane = time * height * width;
        let Normalisation { mean, std } = self.images.normalisation.scaled(self.scale);
        let (pixels, _) = numbers[PIXEL * self.grid.before[2]..][..PIXEL * width].as_chunks_mut();
        match self.images.order {
            Order::Planes => {
                let [red, green, blue] =
                    [0, 1, 2].map(|channel| &self.image[channel * plane + row * width..][..width]);
                for (x, pixel) in pixels.iter_mut().enumerate() {
                    *pixel = [red[x], green[x], blue[x]];
                }
            }
            Order::Pixels => {
                let row = &self.image[PIXEL * row * width..][..PIXEL * width];
                pixels.copy_from_slice(row.as_chunks().0);
            }
        }
        for pixel in pixels {
            for channel in 0..PIXEL {
                pixel[channel] = (pixel[channel] - mean[channel]) / std[channel];
            }
        }
        for (word, numbers) in out.iter_mut().zip(numbers.chunks_exact(W::NUMBERS)) {
            *word = W::of(|i| numbers[i]);
        }
    }
}
