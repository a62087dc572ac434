use serde::{Deserialize, Serialize};

use crate::Frame;

/// What a written frame's file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FrameFormat {
    /// 8 bits per channel, display-referred.
    Png,
    /// Half-precision linear light under lossless ZIP.
    #[cfg(feature = "exr")]
    Exr,
}

/// A frame that its format cannot hold.
#[derive(Debug, thiserror::Error)]
#[error("the frame cannot be encoded: {0}")]
pub struct EncodeError(String);

impl FrameFormat {
    /// What the file's name ends in.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            #[cfg(feature = "exr")]
            Self::Exr => "exr",
        }
    }

    /// The bytes of an image file.
    ///
    /// PNG rounds each value to the nearest of 256 levels, so it reads back within 1/510; EXR
    /// turns it into linear light (the inverse of sRGB) as a half, so it reads back within 0.0003.
    ///
    /// # Errors
    /// Where the frame has no pixels, or its data is not `height * width * 3` values.
    pub fn encode(self, frame: &Frame) -> Result<Vec<u8>, EncodeError> {
        let (width, height) = (frame.width, frame.height);
        let values = width
            .checked_mul(height)
            .and_then(|pixels| pixels.checked_mul(3));
        if frame.data.is_empty() || values != Some(frame.data.len()) {
            let values = frame.data.len();
            let reason = format!("it has {values} values for {width} x {height} pixels");
            return Err(EncodeError(reason));
        }
        match self {
            Self::Png => encode_png(frame).map_err(|error| EncodeError(error.to_string())),
            #[cfg(feature = "exr")]
            Self::Exr => {
                super::exr::encode_half(frame).map_err(|error| EncodeError(error.to_string()))
            }
        }
    }
}

fn encode_png(frame: &Frame) -> Result<Vec<u8>, png::EncodingError> {
    let too_large = |_| png::EncodingError::LimitsExceeded;
    let width = u32::try_from(frame.width).map_err(too_large)?;
    let height = u32::try_from(frame.height).map_err(too_large)?;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    let levels: Vec<u8> = frame
        .data
        .iter()
        .map(|value| (value * 255.0).round() as u8)
        .collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&levels)?;
    writer.finish()?;
    Ok(bytes)
}
