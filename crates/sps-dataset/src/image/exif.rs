use crate::Frame;

/// How a stored image has to be turned to stand upright (EXIF 2.32, tag 0x0112), 1 to 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Orientation(u8);

const ORIENTATION_TAG: u16 = 0x0112;

impl Orientation {
    /// From an EXIF block; upright where it does not say.
    pub(super) fn from_exif(exif: Option<&[u8]>) -> Self {
        let tag = exif
            .and_then(orientation_tag)
            .filter(|value| (1..=8).contains(value));
        Self(tag.map_or(1, |value| value as u8))
    }

    /// Turns the stored image upright.
    pub(super) fn apply(self, frame: Frame) -> Frame {
        if self.0 == 1 {
            return frame;
        }
        let (w, h) = (frame.width, frame.height);
        let (width, height) = if self.0 >= 5 { (h, w) } else { (w, h) };
        let mut data = Vec::with_capacity(frame.data.len());
        for y in 0..height {
            for x in 0..width {
                let (column, row) = match self.0 {
                    2 => (w - 1 - x, y),
                    3 => (w - 1 - x, h - 1 - y),
                    4 => (x, h - 1 - y),
                    5 => (y, x),
                    6 => (y, h - 1 - x),
                    7 => (w - 1 - y, h - 1 - x),
                    _ => (w - 1 - y, x),
                };
                let start = (row * w + column) * 3;
                data.extend_from_slice(&frame.data[start..start + 3]);
            }
        }
        Frame {
            width,
            height,
            data,
        }
    }
}

/// The orientation of the first directory of a TIFF structure.
fn orientation_tag(exif: &[u8]) -> Option<u16> {
    let tiff = exif.strip_prefix(b"Exif\0\0").unwrap_or(exif);
    let little = match tiff.get(..4)? {
        [b'I', b'I', 42, 0] => true,
        [b'M', b'M', 0, 42] => false,
        _ => return None,
    };
    let u16_at = |at: usize| {
        let bytes: [u8; 2] = tiff.get(at..at.checked_add(2)?)?.try_into().ok()?;
        Some(if little {
            u16::from_le_bytes(bytes)
        } else {
            u16::from_be_bytes(bytes)
        })
    };
    let (first, second) = (u16_at(4)?, u16_at(6)?);
    let (high, low) = if little {
        (second, first)
    } else {
        (first, second)
    };
    let directory = usize::from(high) << 16 | usize::from(low);
    let entries = usize::from(u16_at(directory)?);
    (0..entries)
        .map(|entry| directory + 2 + entry * 12)
        .find(|&entry| u16_at(entry) == Some(ORIENTATION_TAG))
        .and_then(|entry| u16_at(entry + 8))
}
