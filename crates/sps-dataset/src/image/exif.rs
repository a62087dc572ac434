use sps_base::parallel;

use crate::Extent;
use crate::files::integer;

/// How a stored image has to be turned to stand upright (EXIF 2.32, tag 0x0112), 1 to 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Orientation(u8);

const ORIENTATION_TAG: u16 = 0x0112;

/// The upright image is filled in squares of so many pixels a side: where its rows are columns of
/// the stored image, what is loaded for a pixel of one holds those of the others.
const TILE: usize = 64;

impl Orientation {
    /// From an EXIF block; upright where it does not say.
    pub(super) fn from_exif(exif: Option<&[u8]>) -> Self {
        let tag = exif
            .and_then(orientation_tag)
            .filter(|value| (1..=8).contains(value));
        Self(tag.map_or(1, |value| value as u8))
    }

    /// Turns a stored image of pixels of `N` bytes upright.
    pub(super) fn apply<const N: usize>(self, stored: Extent, bytes: Vec<u8>) -> (Extent, Vec<u8>) {
        if self.0 == 1 {
            return (stored, bytes);
        }
        let (pixels, _) = bytes.as_chunks::<N>();
        let upright = self.upright(stored);
        let (origin, right, down) = self.steps(stored);
        let stored_at = |x: usize, y: usize| origin + x as isize * right + y as isize * down;
        let mut turned = vec![[0; N]; pixels.len()];
        let bands = turned.chunks_mut(upright.width * TILE).enumerate();
        parallel::each(bands, |(band, rows)| {
            for left in (0..upright.width).step_by(TILE) {
                for (y, row) in (band * TILE..).zip(rows.chunks_exact_mut(upright.width)) {
                    for (x, pixel) in (left..).zip(row[left..].iter_mut().take(TILE)) {
                        *pixel = pixels[stored_at(x, y) as usize];
                    }
                }
            }
        });
        (upright, turned.into_flattened())
    }

    /// How large the upright image is.
    fn upright(self, stored: Extent) -> Extent {
        let Extent { width, height } = stored;
        match self.0 {
            1..=4 => stored,
            _ => Extent {
                width: height,
                height: width,
            },
        }
    }

    /// Which of the stored pixels is the first of the upright image, and how far it is from there to
    /// the one on its right and to the one below.
    fn steps(self, stored: Extent) -> (isize, isize, isize) {
        let (row, rows) = (stored.width as isize, stored.height as isize);
        let (right, bottom) = (row - 1, (rows - 1) * row);
        match self.0 {
            1 => (0, 1, row),
            2 => (right, -1, row),
            3 => (bottom + right, -1, -row),
            4 => (bottom, 1, -row),
            5 => (0, row, 1),
            6 => (bottom, -row, 1),
            7 => (bottom + right, -row, -1),
            _ => (right, row, -1),
        }
    }
}

/// The orientation of the first directory of a TIFF structure.
fn orientation_tag(exif: &[u8]) -> Option<u16> {
    let tiff = exif.strip_prefix(b"Exif\0\0").unwrap_or(exif);
    let is_big_endian = match tiff.get(..4)? {
        [b'I', b'I', 42, 0] => false,
        [b'M', b'M', 0, 42] => true,
        _ => return None,
    };
    let directory = integer(tiff.get(4..8)?, is_big_endian) as usize;
    let u16_at = |at: usize| {
        let bytes = tiff.get(at..at.checked_add(2)?)?;
        Some(integer(bytes, is_big_endian) as u16)
    };
    (0..usize::from(u16_at(directory)?))
        .map(|entry| directory + 2 + entry * 12)
        .find(|&entry| u16_at(entry) == Some(ORIENTATION_TAG))
        .and_then(|entry| u16_at(entry + 8))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// EXIF 2.32 says for each value on which side of the upright image the stored first row and
        /// first column are.
        #[test]
        fn an_image_stands_as_the_standard_says(
            [width, height] in [1_usize..40, 1..40],
            orientation in 1_u8..9,
        ) {
            let bytes = (0..width * height).flat_map(|at| (at as u16).to_le_bytes()).collect();
            let stored = Extent { width, height };
            let (upright, turned) = Orientation(orientation).apply::<2>(stored, bytes);
            let is_sideways = orientation >= 5;
            let sides = if is_sideways { (height, width) } else { (width, height) };
            prop_assert_eq!((upright.width, upright.height), sides);
            let (right, bottom) = (width - 1, height - 1);
            for (at, pixel) in turned.as_chunks().0.iter().enumerate() {
                let (x, y) = (at % upright.width, at / upright.width);
                let (column, row) = match orientation {
                    1 => (x, y),                  // top, left
                    2 => (right - x, y),          // top, right
                    3 => (right - x, bottom - y), // bottom, right
                    4 => (x, bottom - y),         // bottom, left
                    5 => (y, x),                  // left, top
                    6 => (y, bottom - x),         // right, top
                    7 => (right - y, bottom - x), // right, bottom
                    _ => (right - y, x),          // left, bottom
                };
                prop_assert_eq!(usize::from(u16::from_le_bytes(*pixel)), row * width + column);
            }
        }
    }
}
