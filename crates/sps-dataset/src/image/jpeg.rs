use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::exif::Orientation;
use super::jpeg_markers::Markers;
use super::samples::{Depth, Samples};
use super::{FrameErrorKind, ImageFormat, Limits, check_size};
use crate::Extent;

/// The samples of the upright image.
pub(super) fn decode(file: &[u8], limits: &Limits) -> Result<Samples, FrameErrorKind> {
    let markers = Markers::scan(file).ok_or_else(|| {
        FrameErrorKind::damaged(ImageFormat::Jpeg, "it stops before its end mark")
    })?;
    // Lenient decoding paints what is damaged grey; but strict decoding also refuses the stray
    // bytes that some cameras leave between segments.
    let options = DecoderOptions::default()
        .set_strict_mode(!markers.stray_bytes)
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX));
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(file), options);
    decoder.decode_headers().map_err(refused)?;
    let (width, height) = decoder.dimensions().unwrap_or_default();
    check_size(ImageFormat::Jpeg, width as u64, height as u64, limits)?;

    // Four channels are taken for ink as Adobe stores it, like Pillow and browsers do: RGB is
    // (1 - ink) * (1 - black), without a colour profile.
    let grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
    let (wanted, channels) = if grey {
        (ColorSpace::Luma, 1)
    } else {
        (ColorSpace::RGB, 3)
    };
    decoder.set_options(options.jpeg_set_out_colorspace(wanted));
    let bytes = decoder.decode().map_err(refused)?;

    let samples = Samples {
        extent: Extent { width, height },
        channels,
        depth: Depth::Eight,
        bytes,
    };
    let orientation = Orientation::from_exif(decoder.exif().map(Vec::as_slice));
    Ok(samples.upright(orientation))
}

fn refused(error: DecodeErrors) -> FrameErrorKind {
    match error {
        DecodeErrors::Unsupported(scheme) => {
            FrameErrorKind::unsupported(ImageFormat::Jpeg, format!("{scheme:?}"))
        }
        error => FrameErrorKind::damaged(ImageFormat::Jpeg, format!("{error:?}")),
    }
}
