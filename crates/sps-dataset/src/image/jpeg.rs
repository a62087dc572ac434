use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::exif::Orientation;
use super::samples::Samples;
use super::{FrameErrorKind, ImageFormat, Limits, check_size};
use crate::Extent;

/// The samples of the upright image.
pub(super) fn decode(file: &[u8], limits: &Limits) -> Result<Samples, FrameErrorKind> {
    let stray_bytes = has_stray_bytes(file).ok_or_else(|| {
        FrameErrorKind::damaged(ImageFormat::Jpeg, "it stops before its end mark")
    })?;
    // Lenient decoding paints what is damaged grey; but strict decoding also refuses the stray
    // bytes that some cameras leave between segments.
    let options = DecoderOptions::default()
        .set_strict_mode(!stray_bytes)
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
        bytes_per_sample: 1,
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

const END_OF_IMAGE: u8 = 0xd9;
const START_OF_SCAN: u8 = 0xda;

/// Walks from marker to marker up to the end of the image and says whether there are stray bytes
/// between segments, which viewers skip; `None` where the file stops short of the end. Decoders
/// fill what is missing with grey instead.
fn has_stray_bytes(bytes: &[u8]) -> Option<bool> {
    let mut stray_bytes = false;
    let mut at = 2;
    loop {
        if *bytes.get(at)? != 0xff {
            stray_bytes = true;
            at += bytes[at..].iter().position(|&byte| byte == 0xff)?;
        }
        while *bytes.get(at)? == 0xff {
            at += 1;
        }
        let marker = bytes[at];
        at += 1;
        match marker {
            END_OF_IMAGE => return Some(stray_bytes),
            // Restart marks, stuffing and the temporary mark stand alone.
            0xd0..=0xd7 | 0x00 | 0x01 => continue,
            _ => {}
        }
        let length = u16::from_be_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]);
        at += usize::from(length).max(2);
        if marker == START_OF_SCAN {
            at = end_of_scan(bytes, at)?;
        }
    }
}

/// Where the entropy-coded data that begins at `at` ends: the next mark that is no restart.
fn end_of_scan(bytes: &[u8], mut at: usize) -> Option<usize> {
    loop {
        at += bytes.get(at..)?.iter().position(|&byte| byte == 0xff)?;
        if !matches!(bytes.get(at + 1)?, 0x00 | 0xff | 0xd0..=0xd7) {
            return Some(at);
        }
        at += 1;
    }
}
