//! Image files to frames.

mod error;
mod exif;
#[cfg(feature = "exr")]
mod exr;
mod jpeg;
mod png;
mod samples;
mod settings;
mod srgb;
mod write;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use serde::Serialize;

use crate::Frame;
use crate::files::read_bytes;

use error::ImageFormat;
pub use error::{FrameError, FrameErrorKind};
use samples::Samples;
pub use settings::{DecodeSettings, Limits, NonFinite};
pub use write::{EncodeError, FrameFormat};

/// What the name of a photograph's file may end in.
pub const PHOTOGRAPH_ENDINGS: [&str; 4] = ["png", "jpg", "jpeg", "exr"];

/// Which of [`PHOTOGRAPH_ENDINGS`] a file's name ends in, in small or capital letters.
pub fn photograph_ending(path: &Path) -> Option<&'static str> {
    let ending = path.extension()?;
    let mut known = PHOTOGRAPH_ENDINGS.into_iter();
    known.find(|known| ending.eq_ignore_ascii_case(known))
}

/// A frame, and what had to be done to its light to show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// The frame.
    pub frame: Frame,
    /// All zero but for EXR.
    pub light: LightCounts,
}

/// What had to be done to the linear light of an EXR to show it, in samples (three per pixel).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct LightCounts {
    /// NaN, shown black.
    pub nan: usize,
    /// Infinite: shown white, or black where negative.
    pub infinite: usize,
    /// Finite light below zero, shown black.
    pub negative: usize,
    /// Finite light above 1 after exposure, shown white.
    pub clipped: usize,
}

impl LightCounts {
    /// Adds the counts of another frame.
    pub fn add(&mut self, other: &Self) {
        self.nan += other.nan;
        self.infinite += other.infinite;
        self.negative += other.negative;
        self.clipped += other.clipped;
    }
}

/// Decodes the bytes of a PNG, JPEG or EXR, told apart by their first bytes.
///
/// PNG of 8 and 16 bits, grey, palette and with alpha, JPEG in grey, YCbCr, RGB, CMYK and YCCK,
/// with EXIF orientation applied; embedded colour profiles and gamma chunks are ignored. EXR as
/// `docs/dataset-format.md` says.
///
/// # Errors
/// Where the bytes are no whole image of these formats, ask for more than the limits allow, or,
/// for an EXR, lack a channel.
pub fn decode_image(bytes: &[u8], settings: &DecodeSettings) -> Result<Decoded, FrameErrorKind> {
    decode_image_resized(bytes, settings, None)
}

/// Decodes an image as [`decode_image`] does. If `shorter_side` is given, resizes the upright image
/// to it as [`Frame::resized`] does, with the same values. The photograph as a frame, 12 bytes a
/// pixel, is then never there, but for EXR. [`Decoded::light`] counts samples of the photograph.
///
/// # Errors
/// As [`decode_image`], and where the result would be as large as [`Frame::resized`] refuses.
pub fn decode_image_resized(
    bytes: &[u8],
    settings: &DecodeSettings,
    shorter_side: Option<usize>,
) -> Result<Decoded, FrameErrorKind> {
    let format = format_of(bytes)?;
    let of_samples = |samples: Samples| {
        Ok(Decoded {
            frame: samples.to_frame(shorter_side, settings.background)?,
            light: LightCounts::default(),
        })
    };
    let decode = || match format {
        ImageFormat::Png => of_samples(png::decode(bytes, &settings.limits)?),
        ImageFormat::Jpeg => of_samples(jpeg::decode(bytes, &settings.limits)?),
        #[cfg(feature = "exr")]
        ImageFormat::Exr => {
            let mut decoded = exr::decode(bytes, settings)?;
            if let Some(pixels) = shorter_side {
                decoded.frame = decoded.frame.resized(pixels)?.into_owned();
            }
            Ok(decoded)
        }
        #[cfg(not(feature = "exr"))]
        ImageFormat::Exr => {
            let reason = "built without the feature `exr`";
            Err(FrameErrorKind::unsupported(format, reason))
        }
    };
    // The decoders are others' code and have asserts; a damaged file must not end the program.
    catch_unwind(AssertUnwindSafe(decode))
        .unwrap_or_else(|_| Err(FrameErrorKind::damaged(format, "its decoder gave up on it")))
}

/// Reads and decodes one image file; see [`decode_image`].
///
/// # Errors
/// As [`decode_image`], and where the file cannot be read.
pub fn read_image(path: &Path, settings: &DecodeSettings) -> Result<Decoded, FrameError> {
    read_image_resized(path, settings, None)
}

/// Reads and decodes one image file. If `shorter_side` is given, resizes the upright image to it as
/// [`Frame::resized`] does; see [`decode_image_resized`].
///
/// # Errors
/// As [`decode_image_resized`], and where the file cannot be read.
pub fn read_image_resized(
    path: &Path,
    settings: &DecodeSettings,
    shorter_side: Option<usize>,
) -> Result<Decoded, FrameError> {
    read_frame_file(path, settings)
        .and_then(|bytes| decode_image_resized(&bytes, settings, shorter_side))
        .map_err(|kind| FrameError::new(path, kind))
}

/// The bytes of an image file within the limits.
pub(crate) fn read_frame_file(
    path: &Path,
    settings: &DecodeSettings,
) -> Result<Vec<u8>, FrameErrorKind> {
    let limit = settings.limits.file_bytes;
    read_bytes(path, limit, |bytes| FrameErrorKind::FileTooLarge {
        bytes,
        limit,
    })
}

fn format_of(bytes: &[u8]) -> Result<ImageFormat, FrameErrorKind> {
    let found = match bytes {
        [0x89, b'P', b'N', b'G', ..] => return Ok(ImageFormat::Png),
        [0xff, 0xd8, 0xff, ..] => return Ok(ImageFormat::Jpeg),
        [0x76, 0x2f, 0x31, 0x01, ..] => return Ok(ImageFormat::Exr),
        [] => "nothing".to_owned(),
        _ => {
            let first = bytes.iter().take(4).map(|byte| format!(" {byte:02x}"));
            format!("the bytes{}", first.collect::<String>())
        }
    };
    let text = format!("begins with {found}, which is no PNG, JPEG or EXR");
    Err(FrameErrorKind::Invalid(text))
}

/// Refuses dimensions that are zero or beyond the limit.
fn check_size(
    format: ImageFormat,
    width: u64,
    height: u64,
    limits: &Limits,
) -> Result<(), FrameErrorKind> {
    if width == 0 || height == 0 {
        let reason = format!("it says it has {width} x {height} pixels");
        return Err(FrameErrorKind::damaged(format, reason));
    }
    if width.saturating_mul(height) > limits.pixels {
        return Err(FrameErrorKind::TooManyPixels {
            width,
            height,
            limit: limits.pixels,
        });
    }
    Ok(())
}
