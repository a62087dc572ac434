//! Images brought to another size.

use std::ops::Range;

use sps_base::parallel;

use crate::{Extent, Frame};

/// So many new rows are made together: most old rows count in two, and are read once for both.
const ROWS_TOGETHER: usize = 8;

/// An image of extent `from`, of which `read` writes row `y` as `from.width * 3` values, resampled
/// with a triangle filter as wide as the pixels that it takes together, its values brought into
/// 0 to 1: bit for bit `image::imageops::resize`.
///
/// Neither extent may be empty.
pub(crate) fn resample(from: Extent, to: Extent, read: impl Fn(usize, &mut [f32]) + Sync) -> Frame {
    let columns = Taps::of_side(from.width, to.width);
    let rows = Taps::of_side(from.height, to.height);
    let mut data = vec![0.0; 3 * to.width * to.height];
    let parts = data.chunks_mut(3 * to.width * ROWS_TOGETHER);
    parallel::each(parts.zip(rows.chunks(ROWS_TOGETHER)), |(data, rows)| {
        let sums = sum_rows(3 * from.width, rows, &read);
        let sums = sums.chunks_exact(3 * from.width);
        for (sums, row) in sums.zip(data.chunks_exact_mut(3 * to.width)) {
            sum_columns(sums.as_chunks().0, &columns, row.as_chunks_mut().0);
        }
    });
    Frame {
        width: to.width,
        height: to.height,
        data,
    }
}

/// The sums over old rows, each of `length` values, that neighbouring new ones are.
fn sum_rows(length: usize, rows: &[Taps], read: impl Fn(usize, &mut [f32])) -> Vec<f32> {
    let mut sums = vec![0.0; length * rows.len()];
    let mut row = vec![0.0; length];
    let first = rows.first().map_or(0, |taps| taps.first);
    let end = rows.last().map_or(0, |taps| taps.range().end);
    for y in first..end {
        read(y, &mut row);
        for (taps, sums) in rows.iter().zip(sums.chunks_exact_mut(length)) {
            if !taps.range().contains(&y) {
                continue;
            }
            let weight = taps.weights[y - taps.first];
            for (sum, value) in sums.iter_mut().zip(&row) {
                *sum += value * weight;
            }
        }
    }
    sums
}

/// The pixels of a new row.
fn sum_columns(old: &[[f32; 3]], columns: &[Taps], new: &mut [[f32; 3]]) {
    for (taps, pixel) in columns.iter().zip(new) {
        let mut sum = [0.0; 3];
        for ([red, green, blue], weight) in old[taps.range()].iter().zip(&taps.weights) {
            sum[0] += red * weight;
            sum[1] += green * weight;
            sum[2] += blue * weight;
        }
        *pixel = sum.map(|value| value.clamp(0.0, 1.0));
    }
}

/// The old pixels along a side that a new one is a mean of.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

impl Taps {
    /// Those of each new pixel along a side of `from` pixels that gets `to`; neither their first nor
    /// their last ever goes back.
    fn of_side(from: usize, to: usize) -> Vec<Self> {
        let ratio = from as f32 / to as f32;
        let reach = ratio.max(1.0);
        let at = |at: usize| {
            let centre = (at as f32 + 0.5) * ratio;
            let first = ((centre - reach).floor() as usize).min(from - 1);
            let end = ((centre + reach).ceil() as usize).clamp(first + 1, from);
            let weight = |pixel: usize| {
                let distance = (pixel as f32 - (centre - 0.5)) / reach;
                (1.0 - distance.abs()).max(0.0)
            };
            let sum: f32 = (first..end).map(weight).sum();
            let weights = (first..end).map(|pixel| weight(pixel) / sum).collect();
            Self { first, weights }
        };
        (0..to).map(at).collect()
    }

    fn range(&self) -> Range<usize> {
        self.first..self.first + self.weights.len()
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb32FImage;
    use image::imageops::{FilterType, resize};
    use proptest::prelude::*;

    use super::*;
    use crate::FrameErrorKind;

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
            [width, height, shorter_side] in [1_usize..70, 1..70, 1..70],
            seed in 0_usize..255,
        ) {
            let frame = frame(width, height, seed);
            prop_assume!(shorter_side != width.min(height)); // as it is, not resampled
            let image = Rgb32FImage::from_raw(width as u32, height as u32, frame.data.clone());
            let resized = frame.resized(shorter_side).unwrap();
            let (to_width, to_height) = (resized.width as u32, resized.height as u32);
            let image = resize(&image.unwrap(), to_width, to_height, FilterType::Triangle);
            let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&resized.data), bits(image.as_raw()));
        }
    }

    #[test]
    fn a_frame_of_that_size_is_as_it_was() {
        let frame = frame(5, 3, 0);
        assert_eq!(*frame.resized(3).unwrap(), frame);
        assert!(frame.data.iter().any(|value| *value > 1.0));
    }

    #[test]
    fn the_longer_side_is_rounded_and_never_nothing() {
        let sides = |width, height, shorter_side| {
            let extent = Extent { width, height }.with_shorter_side(shorter_side);
            [extent.width, extent.height]
        };
        assert_eq!(sides(4000, 3000, 224), [299, 224]); // 298.67
        assert_eq!(sides(3000, 4000, 224), [224, 299]);
        assert_eq!(sides(640, 480, 240), [320, 240]);
        assert_eq!(sides(5, 2, 1), [3, 1]); // 2.5
        assert_eq!(sides(9, 7, 0), [1, 1]);
    }

    #[test]
    fn a_frame_without_its_pixels_is_refused() {
        let mut frame = frame(4, 3, 0);
        frame.data.pop();
        let message = frame.resized(2).unwrap_err().to_string();
        let expected = "has 35 values for 4 x 3 pixels, expected three for each";
        assert_eq!(message, expected);
        frame.data.clear();
        frame.height = 0;
        assert!(frame.resized(2).is_err());
    }

    #[test]
    fn a_size_beyond_the_limit_is_refused() {
        let refused = frame(3, 2, 0).resized(5000).unwrap_err();
        let expected = "would have 7500 x 5000 pixels with a shorter side of 5000, more than the \
                        limit of 33554432";
        assert_eq!(refused.to_string(), expected);
        let refused = frame(3, 2, 0).resized(usize::MAX).unwrap_err();
        assert!(matches!(refused, FrameErrorKind::ResizedTooLarge { .. }));
    }
}
