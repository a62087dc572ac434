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
    decode(bytes, settings, |stored| Ok(stored.shown(settings)))
}

/// Decodes an image as [`decode_image`] does and brings its shorter side, once it stands upright, to
/// so many pixels as [`Frame::resized`] does, with the same values. The photograph as a frame, 12
/// bytes a pixel, is then never there, but for EXR. [`Decoded::light`] counts samples of the
/// photograph.
///
/// # Errors
/// As [`decode_image`], and where the result would be as large as [`Frame::resized`] refuses.
pub fn decode_image_resized(
    bytes: &[u8],
    settings: &DecodeSettings,
    shorter_side: usize,
) -> Result<Decoded, FrameErrorKind> {
    decode(bytes, settings, |stored| {
        stored.resized(settings, shorter_side)
    })
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

/// Reads and decodes one image file and brings its shorter side to so many pixels; see
/// [`decode_image_resized`].
///
/// # Errors
/// As [`decode_image_resized`], and where the file cannot be read.
pub fn read_image_resized(
    path: &Path,
    settings: &DecodeSettings,
    shorter_side: usize,
) -> Result<Decoded, FrameError> {
    read_frame_file(path, settings)
        .and_then(|bytes| decode_image_resized(&bytes, settings, shorter_side))
        .map_err(|kind| FrameError::new(path, kind))
}

/// An upright image as its file gives it.
enum Stored {
    Samples(Samples),
    #[cfg(feature = "exr")]
    Light(Decoded),
}

impl Stored {
    fn shown(self, settings: &DecodeSettings) -> Decoded {
        match self {
            Self::Samples(samples) => Decoded {
                frame: samples.to_frame(settings.background),
                light: LightCounts::default(),
            },
            #[cfg(feature = "exr")]
            Self::Light(decoded) => decoded,
        }
    }

    fn resized(
        self,
        settings: &DecodeSettings,
        shorter_side: usize,
    ) -> Result<Decoded, FrameErrorKind> {
        match self {
            Self::Samples(samples) => Ok(Decoded {
                frame: samples.to_resized_frame(shorter_side, settings.background)?,
                light: LightCounts::default(),
            }),
            #[cfg(feature = "exr")]
            Self::Light(Decoded { frame, light }) => Ok(Decoded {
                frame: frame.resized(shorter_side)?.into_owned(),
                light,
            }),
        }
    }
}

/// What `make` makes of an image.
fn decode(
    bytes: &[u8],
    settings: &DecodeSettings,
    make: impl FnOnce(Stored) -> Result<Decoded, FrameErrorKind>,
) -> Result<Decoded, FrameErrorKind> {
    let format = format_of(bytes)?;
    let decode = || match format {
        ImageFormat::Png => png::decode(bytes, &settings.limits).map(Stored::Samples),
        ImageFormat::Jpeg => jpeg::decode(bytes, &settings.limits).map(Stored::Samples),
        #[cfg(feature = "exr")]
        ImageFormat::Exr => exr::decode(bytes, settings).map(Stored::Light),
        #[cfg(not(feature = "exr"))]
        ImageFormat::Exr => Err(FrameErrorKind::unsupported(
            format,
            "built without the feature `exr`",
        )),
    };
    // The decoders are others' code and have asserts; a damaged file must not end the program.
    catch_unwind(AssertUnwindSafe(|| make(decode()?)))
        .unwrap_or_else(|_| Err(FrameErrorKind::damaged(format, "its decoder gave up on it")))
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
