use std::io::Cursor;

use png::{BitDepth, ColorType, Decoder, DecodingError, Transformations};

use super::exif::Orientation;
use super::samples::Samples;
use super::{FrameErrorKind, ImageFormat, Limits, check_size};
use crate::Extent;

/// The samples of the upright image.
pub(super) fn decode(file: &[u8], limits: &Limits) -> Result<Samples, FrameErrorKind> {
    // Four channels of 16 bits.
    let most = usize::try_from(limits.pixels.saturating_mul(8)).unwrap_or(usize::MAX);
    let mut decoder = Decoder::new_with_limits(Cursor::new(file), png::Limits { bytes: most });
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder.ignore_checksums(false);
    decoder.set_transformations(Transformations::EXPAND);
    let header = decoder.read_header_info().map_err(refused)?;
    let (width, height) = (header.width.into(), header.height.into());
    check_size(ImageFormat::Png, width, height, limits)?;

    let mut reader = decoder.read_info().map_err(refused)?;
    check_palette(reader.info().palette.as_deref().unwrap_or_default())?;
    let size = reader.output_buffer_size().filter(|&size| size <= most);
    let size = size.ok_or_else(|| refused(DecodingError::LimitsExceeded))?;
    let mut bytes = vec![0; size];
    let output = reader.next_frame(&mut bytes).map_err(refused)?;
    // To the end mark, so that a file that is cut after its last row is not taken for whole.
    reader.finish().map_err(refused)?;

    let samples = Samples {
        extent: Extent {
            width: output.width as usize,
            height: output.height as usize,
        },
        channels: match output.color_type {
            ColorType::Grayscale => 1,
            ColorType::GrayscaleAlpha => 2,
            ColorType::Rgb | ColorType::Indexed => 3,
            ColorType::Rgba => 4,
        },
        bytes_per_sample: match output.bit_depth {
            BitDepth::Sixteen => 2,
            // What has fewer bits than eight is expanded to eight.
            _ => 1,
        },
        bytes,
    };
    let orientation = Orientation::from_exif(reader.info().exif_metadata.as_deref());
    Ok(samples.upright(orientation))
}

/// The decoder takes the colours for whole, and for no more than a byte can tell apart.
fn check_palette(palette: &[u8]) -> Result<(), FrameErrorKind> {
    let bytes = palette.len();
    if bytes.is_multiple_of(3) && bytes <= 3 * 256 {
        return Ok(());
    }
    let reason = format_args!("a palette of {bytes} bytes, expected three for each of 1 to 256");
    Err(FrameErrorKind::damaged(ImageFormat::Png, reason))
}

fn refused(error: DecodingError) -> FrameErrorKind {
    FrameErrorKind::damaged(ImageFormat::Png, error)
}
