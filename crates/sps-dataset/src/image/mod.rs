//! Image files to frames.

mod error;
mod exif;
#[cfg(feature = "exr")]
mod exr;
mod jpeg;
mod jpeg_markers;
mod light;
mod png;
mod samples;
mod settings;
mod srgb;
mod write;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use crate::Frame;
use crate::files::{ReadError, read_bytes};

pub use error::{FrameError, FrameErrorKind, ImageFormat};
pub use light::LightCounts;
pub use settings::{DecodeSettings, Limits, NonFinite};
pub use write::{EncodeError, FrameFormat};

/// A frame, and what had to be done to its light to show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// The frame.
    pub frame: Frame,
    /// All zero but for EXR.
    pub light: LightCounts,
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
    let format = format_of(bytes)?;
    let decode = || match format {
        ImageFormat::Png => png::decode(bytes, settings),
        ImageFormat::Jpeg => jpeg::decode(bytes, settings),
        #[cfg(feature = "exr")]
        ImageFormat::Exr => exr::decode(bytes, settings),
        #[cfg(not(feature = "exr"))]
        ImageFormat::Exr => Err(FrameErrorKind::unsupported(
            format,
            "built without the feature `exr`",
        )),
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
    read_frame_file(path, settings)
        .and_then(|bytes| decode_image(&bytes, settings))
        .map_err(|kind| FrameError::new(path, kind))
}

/// The bytes of an image file within the limits.
pub(crate) fn read_frame_file(
    path: &Path,
    settings: &DecodeSettings,
) -> Result<Vec<u8>, FrameErrorKind> {
    read_bytes(path, settings.limits.file_bytes).map_err(|error| match error {
        ReadError::Io(error) => FrameErrorKind::Io(error),
        ReadError::TooLarge { bytes, limit } => FrameErrorKind::FileTooLarge { bytes, limit },
    })
}

fn format_of(bytes: &[u8]) -> Result<ImageFormat, FrameErrorKind> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => Ok(ImageFormat::Png),
        [0xff, 0xd8, 0xff, ..] => Ok(ImageFormat::Jpeg),
        [0x76, 0x2f, 0x31, 0x01, ..] => Ok(ImageFormat::Exr),
        [] => Err(FrameErrorKind::UnknownFormat {
            found: "nothing".to_owned(),
        }),
        _ => {
            let first: Vec<_> = bytes
                .iter()
                .take(4)
                .map(|byte| format!("{byte:02x}"))
                .collect();
            Err(FrameErrorKind::UnknownFormat {
                found: format!("the bytes {}", first.join(" ")),
            })
        }
    }
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
