//! Images brought to another size.

use anyhow::{Result, ensure};
use sps_dataset::Frame;

/// The frame resampled with a triangle filter as wide as the pixels that it takes together, its
/// values brought into 0 to 1: bit for bit `image::imageops::resize` on every machine.
pub(super) fn resample(frame: &Frame, width: usize, height: usize) -> Result<Frame> {
    ensure!(
        !frame.data.is_empty() && frame.data.len() == 3 * frame.width * frame.height,
        "an image of {} x {} pixels with {} values, expected three for each pixel",
        frame.width,
        frame.height,
        frame.data.len()
    );
    let columns: Vec<Taps> = taps(frame.width, width).collect();
    let mut data = Vec::with_capacity(3 * width * height);
    let mut row = vec![0.0; 3 * frame.width];
    for (first, weights) in taps(frame.height, height) {
        row.fill(0.0);
        let sources = frame.data.chunks_exact(row.len()).skip(first);
        for (source, weight) in sources.zip(weights) {
            for (sum, value) in row.iter_mut().zip(source) {
                *sum += value * weight;
            }
        }
        for (first, weights) in &columns {
            let mut pixel = [0.0; 3];
            for (source, weight) in row.as_chunks().0[*first..].iter().zip(weights) {
                let [red, green, blue]: &[f32; 3] = source;
                pixel[0] += red * weight;
                pixel[1] += green * weight;
                pixel[2] += blue * weight;
            }
            data.extend(pixel.map(|value| value.clamp(0.0, 1.0)));
        }
    }
    Ok(Frame {
        width,
        height,
        data,
    })
}

/// The first of the old pixels along a side that a new one is a mean of, and their weights.
type Taps = (usize, Vec<f32>);

/// The taps of each new pixel along a side of `from` pixels that gets `to`.
fn taps(from: usize, to: usize) -> impl Iterator<Item = Taps> {
    let ratio = from as f32 / to as f32;
    let reach = ratio.max(1.0);
    (0..to).map(move |at| {
        let centre = (at as f32 + 0.5) * ratio;
        let first = ((centre - reach).floor() as usize).min(from - 1);
        let end = ((centre + reach).ceil() as usize).clamp(first + 1, from);
        let weight = |pixel: usize| {
            let distance = (pixel as f32 - (centre - 0.5)) / reach;
            (1.0 - distance.abs()).max(0.0)
        };
        let sum: f32 = (first..end).map(weight).sum();
        let weights = (first..end).map(|pixel| weight(pixel) / sum);
        (first, weights.collect())
    })
}

#[cfg(test)]
mod tests {
    use image::Rgb32FImage;
    use image::imageops::{FilterType, resize};
    use proptest::prelude::*;

    use super::*;

    fn frame(width: usize, height: usize, seed: usize) -> Frame {
        // Some lie outside 0 to 1.
        let value = |i: usize| ((i * i * 31 + (i + seed) * 17) % 255) as f32 / 200.0 - 0.1;
        Frame {
            width,
            height,
            data: (0..3 * width * height).map(value).collect(),
        }
    }

    proptest! {
        #[test]
        fn is_that_of_the_image_crate_bit_for_bit(
            [width, height, to_width, to_height] in [1_usize..70, 1..70, 1..70, 1..70],
            seed in 0_usize..255,
        ) {
            let frame = frame(width, height, seed);
            let image = Rgb32FImage::from_raw(width as u32, height as u32, frame.data.clone());
            let (wanted_width, wanted_height) = (to_width as u32, to_height as u32);
            let image = resize(&image.unwrap(), wanted_width, wanted_height, FilterType::Triangle);
            let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            prop_assume!((width, height) != (to_width, to_height)); // copied, not resampled
            let found = resample(&frame, to_width, to_height).unwrap();
            prop_assert_eq!(bits(&found.data), bits(image.as_raw()));
        }
    }

    #[test]
    fn an_image_without_its_pixels_is_refused() {
        let mut frame = frame(4, 3, 0);
        frame.data.pop();
        let message = resample(&frame, 2, 2).unwrap_err().to_string();
        assert!(message.contains("4 x 3 pixels with 35 values"), "{message}");
        frame.data.clear();
        frame.height = 0;
        assert!(resample(&frame, 2, 2).is_err());
    }
}
