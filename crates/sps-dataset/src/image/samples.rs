use super::FrameErrorKind;
use super::exif::Orientation;
use crate::resample::resample;
use crate::{Extent, Frame};

/// Decoded samples as PNG and JPEG have them: interleaved, row-major.
pub(super) struct Samples {
    pub(super) extent: Extent,
    /// 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha.
    pub(super) channels: usize,
    /// 1, or 2 in big-endian order, as PNG stores them.
    pub(super) bytes_per_sample: usize,
    pub(super) bytes: Vec<u8>,
}

impl Samples {
    /// Turns the stored image upright.
    pub(super) fn upright(self, orientation: Orientation) -> Self {
        let turn = match self.pixel() {
            1 => Orientation::apply::<1>,
            2 => Orientation::apply::<2>,
            3 => Orientation::apply::<3>,
            4 => Orientation::apply::<4>,
            6 => Orientation::apply::<6>,
            _ => Orientation::apply::<8>,
        };
        let (extent, bytes) = turn(orientation, self.extent, self.bytes);
        Self {
            extent,
            bytes,
            ..self
        }
    }

    /// The frame: the largest sample becomes 1, grey fills all three channels, and transparent
    /// pixels show `background`, mixed in the display-referred values as browsers do. If
    /// `shorter_side` is given, resizes the upright image to it as [`Frame::resized`] does, without
    /// the whole of it ever being there.
    pub(super) fn to_frame(
        &self,
        shorter_side: Option<usize>,
        background: [f32; 3],
    ) -> Result<Frame, FrameErrorKind> {
        let from = self.extent;
        let to = shorter_side.map_or(Ok(from), |pixels| from.resized(pixels))?;
        if to != from {
            return Ok(resample(from, to, |y, row| {
                self.read_row(y, background, row);
            }));
        }
        let Extent { width, height } = from;
        let mut data = Vec::with_capacity(3 * width * height);
        let mut row = vec![0.0; 3 * width];
        for y in 0..height {
            self.read_row(y, background, &mut row);
            data.extend_from_slice(&row);
        }
        Ok(Frame {
            width,
            height,
            data,
        })
    }

    /// Bytes of a pixel.
    fn pixel(&self) -> usize {
        self.bytes_per_sample * self.channels
    }

    fn read_row(&self, y: usize, background: [f32; 3], row: &mut [f32]) {
        let length = self.extent.width * self.pixel();
        let bytes = &self.bytes[y * length..][..length];
        if self.bytes_per_sample == 1 {
            let samples = bytes.iter().map(|&byte| f32::from(byte) / 255.0);
            mix(samples, self.channels, background, row);
        } else {
            let pairs = bytes.as_chunks().0.iter();
            let samples = pairs.map(|&pair| f32::from(u16::from_be_bytes(pair)) / 65535.0);
            mix(samples, self.channels, background, row);
        }
    }
}

fn mix(
    mut samples: impl Iterator<Item = f32>,
    channels: usize,
    background: [f32; 3],
    row: &mut [f32],
) {
    if channels == 3 {
        for (value, sample) in row.iter_mut().zip(samples) {
            *value = sample;
        }
        return;
    }
    for pixel in row.as_chunks_mut::<3>().0 {
        let mut next = || samples.next().unwrap_or(0.0);
        let first = next();
        let (rgb, alpha) = match channels {
            1 => ([first; 3], 1.0),
            2 => ([first; 3], next()),
            _ => ([first, next(), next()], next()),
        };
        let shown = |channel| rgb[channel] * alpha + background[channel] * (1.0 - alpha);
        *pixel = [0, 1, 2].map(shown);
    }
}
