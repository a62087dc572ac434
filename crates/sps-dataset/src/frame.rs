use std::borrow::Cow;

use crate::Limits;
use crate::image::FrameErrorKind;
use crate::resample::resample;

/// One image of a surface: RGB, interleaved, row-major, f32.
///
/// Values are display-referred (sRGB-encoded) and nominally lie in `[0, 1]`; the value at row `y`,
/// column `x`, channel `c` is `data[(y * width + x) * 3 + c]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width * 3` values.
    pub data: Vec<f32>,
}

/// How large an image is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// One image of a surface in scene-linear light: RGB, interleaved, row-major, f32, laid out as a
/// [`Frame`] is. 1 is the display's white; highlights lie above it.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearFrame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width * 3` values.
    pub data: Vec<f32>,
}

impl Frame {
    /// How large it is.
    pub fn extent(&self) -> Extent {
        Extent {
            width: self.width,
            height: self.height,
        }
    }

    /// The frame at the extent of [`Extent::with_shorter_side`]: resampled with a triangle filter as
    /// wide as the pixels that it takes together, and its values brought into `[0, 1]`; or as it is
    /// where it has that extent. Bit for bit `image::imageops::resize` with its `Triangle`, on every
    /// machine and with any number of threads.
    ///
    /// To have a photograph of many pixels at the size of a few,
    /// [`read_image_resized`](crate::read_image_resized) takes a fraction of the memory.
    ///
    /// # Errors
    /// [`FrameErrorKind::Invalid`] where the frame has no pixels, or its data is not `height * width *
    /// 3` values; [`FrameErrorKind::ResizedTooLarge`] where the result would have more pixels than
    /// [`Limits::pixels`] are by default.
    ///
    /// ```
    /// use sps_dataset::Frame;
    ///
    /// let frame = Frame { width: 6, height: 4, data: vec![0.5; 6 * 4 * 3] };
    /// let resized = frame.resized(2)?;
    /// assert_eq!((resized.width, resized.height), (3, 2));
    /// # Ok::<(), sps_dataset::FrameErrorKind>(())
    /// ```
    pub fn resized(&self, shorter_side: usize) -> Result<Cow<'_, Self>, FrameErrorKind> {
        let checked = check_values(self.extent(), &self.data);
        checked.map_err(FrameErrorKind::Invalid)?;
        let extent = self.extent().resized(shorter_side)?;
        if extent == self.extent() {
            return Ok(Cow::Borrowed(self));
        }
        let row_of = |y: usize| &self.data[y * 3 * self.width..][..3 * self.width];
        Ok(Cow::Owned(resample(self.extent(), extent, |y, row| {
            row.copy_from_slice(row_of(y));
        })))
    }
}

impl Extent {
    /// The extent of the same shape, but for rounding, whose shorter side has so many pixels; of at
    /// least one pixel either way.
    #[must_use]
    pub fn with_shorter_side(self, pixels: usize) -> Self {
        let shorter = self.width.min(self.height);
        if pixels == shorter {
            return self;
        }
        let scale = pixels as f64 / shorter as f64;
        let side = |length: usize| ((length as f64 * scale).round() as usize).max(1);
        Self {
            width: side(self.width),
            height: side(self.height),
        }
    }

    /// [`Self::with_shorter_side`], where that is of no more pixels than a frame may have.
    pub(crate) fn resized(self, shorter_side: usize) -> Result<Self, FrameErrorKind> {
        let limit = Limits::default().pixels;
        let Self { width, height } = self.with_shorter_side(shorter_side);
        if (width as u64).saturating_mul(height as u64) > limit {
            return Err(FrameErrorKind::ResizedTooLarge {
                shorter_side,
                width,
                height,
                limit,
            });
        }
        Ok(Self { width, height })
    }
}

/// Refuses an image without pixels, or with other than three values for each.
pub(crate) fn check_values(extent: Extent, data: &[f32]) -> Result<(), String> {
    let Extent { width, height } = extent;
    let pixels = width.checked_mul(height);
    let values = data.len();
    if values > 0 && pixels.and_then(|pixels| pixels.checked_mul(3)) == Some(values) {
        return Ok(());
    }
    let found = format!("{values} values for {width} x {height} pixels");
    Err(format!("has {found}, expected three for each"))
}
