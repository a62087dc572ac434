use rand::Rng;

use super::Augmentation;
use crate::error::{Result, require};

/// An image to train on, or a sequence of frames where the encoder
/// [takes those](crate::encoders::EncoderKind::takes_sequences): f32 in 0..=1, display-referred RGB,
/// interleaved, row by row, frame by frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Of a sequence.
    frames: Option<usize>,
    height: usize,
    width: usize,
    pixels: Vec<f32>,
}

impl Image {
    /// An image of `(height, width, 3)` values.
    ///
    /// # Errors
    /// When there are not as many values as the size asks for.
    pub fn new(height: usize, width: usize, pixels: Vec<f32>) -> Result<Self> {
        Self::of(None, height, width, pixels)
    }

    /// A sequence of `(frames, height, width, 3)` values.
    ///
    /// # Errors
    /// When there are not as many values as the size asks for.
    pub fn sequence(frames: usize, height: usize, width: usize, pixels: Vec<f32>) -> Result<Self> {
        Self::of(Some(frames), height, width, pixels)
    }

    fn of(frames: Option<usize>, height: usize, width: usize, pixels: Vec<f32>) -> Result<Self> {
        let image = Self {
            frames,
            height,
            width,
            pixels,
        };
        let shape = image.shape();
        let wanted = shape.iter().fold(1_usize, |all, &n| all.saturating_mul(n));
        let found = format_args!("{} values of {shape:?}", image.pixels.len());
        let filled = image.pixels.len() == wanted && wanted > 0;
        require(filled, "image", found, format_args!("{wanted}, at least 3"))?;
        Ok(image)
    }

    /// `([frames,] height, width, 3)`
    pub(super) fn shape(&self) -> Vec<usize> {
        let frames = self.frames.into_iter();
        frames.chain([self.height, self.width, 3]).collect()
    }

    /// The frames of a sequence; none of an image.
    pub fn frames(&self) -> Option<usize> {
        self.frames
    }

    /// Height and width in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.height, self.width)
    }

    /// The values, `(height, width, 3)`; of a sequence, `(frames, height, width, 3)`.
    pub fn pixels(&self) -> &[f32] {
        &self.pixels
    }

    /// The image as it is shown this once; all frames of a sequence alike.
    pub(super) fn varied(&self, augmentation: &Augmentation, rng: &mut impl Rng) -> Self {
        let mut image = self.cropped(augmentation, rng);
        let factor =
            |rng: &mut dyn rand::RngCore, by: f64| (1.0 + by * rng.random_range(-1.0..=1.0)) as f32;
        let brightness = factor(rng, augmentation.brightness);
        let contrast = factor(rng, augmentation.contrast);
        let colours: [f32; 3] = std::array::from_fn(|_| factor(rng, augmentation.colour));
        let mean = image.pixels.iter().map(|&v| f64::from(v)).sum::<f64>();
        let mean = (mean / image.pixels.len() as f64) as f32;
        for pixel in image.pixels.chunks_exact_mut(3) {
            for (value, colour) in pixel.iter_mut().zip(colours) {
                let around_mean = mean + contrast * (*value - mean);
                *value = (brightness * colour * around_mean).clamp(0.0, 1.0);
            }
        }
        image
    }

    /// A square somewhere in the image, perhaps upside down.
    fn cropped(&self, augmentation: &Augmentation, rng: &mut impl Rng) -> Self {
        let shorter = self.height.min(self.width);
        let side = (augmentation.crop * shorter as f64).round() as usize;
        let side = side.clamp(1, shorter);
        let top = rng.random_range(0..=self.height - side);
        let left = rng.random_range(0..=self.width - side);
        let flip = rng.random_bool(0.5) && augmentation.flip;
        let rows = (0..side).map(|row| top + if flip { side - 1 - row } else { row });
        let frames = self.pixels.chunks_exact(3 * self.height * self.width);
        let pixels = frames.flat_map(|frame| {
            rows.clone().flat_map(move |row| {
                let from = (row * self.width + left) * 3;
                frame[from..from + 3 * side].iter().copied()
            })
        });
        Self {
            frames: self.frames,
            height: side,
            width: side,
            pixels: pixels.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sps_base::streams::named_stream;

    fn ramp(height: usize, width: usize) -> Image {
        let len = height * width * 3;
        let pixels = (0..len).map(|i| i as f32 / len as f32).collect();
        Image::new(height, width, pixels).unwrap()
    }

    fn same(one: &[f32], other: &[f32]) -> bool {
        let mut pairs = one.iter().zip(other);
        one.len() == other.len() && pairs.all(|(a, b)| (a - b).abs() < 1e-6)
    }

    const STILL: Augmentation = Augmentation::STILL;

    #[test]
    fn without_variation_an_image_stays_as_it_is() {
        let image = ramp(5, 5);
        let shown = image.varied(&STILL, &mut named_stream(0, "test", 0));
        assert!(same(&shown.pixels, &image.pixels));
    }

    #[test]
    fn a_crop_is_a_part_of_the_image() {
        let image = ramp(8, 12);
        let half = Augmentation { crop: 0.5, ..STILL };
        for index in 0..20 {
            let part = image.varied(&half, &mut named_stream(0, "test", index));
            assert_eq!(part.size(), (4, 4));
            let corner = |v: &f32| (v - part.pixels[0]).abs() < 1e-6;
            let first = image.pixels.iter().position(corner).unwrap();
            let second_row = &image.pixels[first + 36..first + 48];
            assert!(same(&part.pixels[12..24], second_row));
        }
    }

    #[test]
    fn half_of_the_images_are_turned_upside_down() {
        let image = ramp(4, 4);
        let flip = Augmentation {
            flip: true,
            ..STILL
        };
        let turned = (0..1000).filter(|&index| {
            let shown = image.varied(&flip, &mut named_stream(0, "test", index));
            let upside_down = same(&shown.pixels[..12], &image.pixels[36..]);
            assert!(upside_down || same(&shown.pixels, &image.pixels));
            upside_down
        });
        let turned = turned.count();
        assert!((450..550).contains(&turned), "{turned}");
    }

    #[test]
    fn frames_of_a_sequence_are_varied_alike() {
        let image = ramp(6, 9);
        let pixels = image.pixels.repeat(3);
        let sequence = Image::sequence(3, 6, 9, pixels).unwrap();
        let strong = Augmentation {
            crop: 0.7,
            flip: true,
            brightness: 0.3,
            contrast: 0.3,
            colour: 0.3,
        };
        for index in 0..20 {
            let shown = |image: &Image| image.varied(&strong, &mut named_stream(0, "test", index));
            let (expected, found) = (shown(&image), shown(&sequence));
            assert_eq!(found.shape(), [3, 4, 4, 3]);
            for frame in found.pixels.chunks_exact(expected.pixels.len()) {
                assert!(same(frame, &expected.pixels));
            }
        }
    }

    #[test]
    fn a_size_that_the_values_do_not_fill_is_refused() {
        assert!(Image::new(2, 2, vec![0.0; 11]).is_err());
        assert!(Image::new(0, 2, vec![]).is_err());
        assert!(Image::sequence(2, 2, 2, vec![0.0; 12]).is_err());
        assert!(Image::sequence(usize::MAX, 2, 2, vec![0.0; 12]).is_err());
    }

    mod hard_cases {
        use super::*;

        #[test]
        fn colours_stay_in_range_and_constant_images_constant() {
            let strong = Augmentation {
                brightness: 0.99,
                contrast: 0.99,
                colour: 0.0,
                ..STILL
            };
            for (index, value) in (0..100).zip([0.0, 1.0, 0.5].into_iter().cycle()) {
                let image = Image::new(3, 3, vec![value; 27]).unwrap();
                let shown = image.varied(&strong, &mut named_stream(0, "test", index));
                assert!(shown.pixels.iter().all(|v| (0.0..=1.0).contains(v)));
                assert!(shown.pixels.iter().all(|v| *v == shown.pixels[0]));
            }
        }
    }
}
