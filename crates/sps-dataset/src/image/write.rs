use serde::{Deserialize, Serialize};

#[cfg(feature = "exr")]
use super::srgb::srgb_decode;
use super::srgb::srgb_encode;
use crate::frame::check_values;
use crate::{Extent, Frame, LinearFrame};

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

    /// The bytes of an image file of a display-referred frame.
    ///
    /// PNG rounds each value to the nearest of 256 levels, so it reads back within 1/510; EXR
    /// turns it into linear light (the inverse of sRGB) as a half, so it reads back within 0.0003.
    ///
    /// # Errors
    /// Where the frame has no pixels, or its data is not `height * width * 3` values.
    pub fn encode(self, frame: &Frame) -> Result<Vec<u8>, EncodeError> {
        match self {
            Self::Png => {
                check(frame.extent(), &frame.data)?;
                encode_png(frame).map_err(|error| EncodeError(error.to_string()))
            }
            #[cfg(feature = "exr")]
            Self::Exr => self.encode_linear(&LinearFrame {
                width: frame.width,
                height: frame.height,
                data: frame.data.iter().copied().map(srgb_decode).collect(),
            }),
        }
    }

    /// The bytes of an image file of scene-linear light.
    ///
    /// EXR keeps it as halves: to 11 bits, up to 65504. PNG shows it: clipped to `[0, 1]`, encoded
    /// as sRGB and rounded as in [`FrameFormat::encode`].
    ///
    /// # Errors
    /// As [`FrameFormat::encode`].
    pub fn encode_linear(self, light: &LinearFrame) -> Result<Vec<u8>, EncodeError> {
        match self {
            Self::Png => {
                let values = light.data.iter().map(|value| value.clamp(0.0, 1.0));
                self.encode(&Frame {
                    width: light.width,
                    height: light.height,
                    data: values.map(srgb_encode).collect(),
                })
            }
            #[cfg(feature = "exr")]
            Self::Exr => {
                let (width, height) = (light.width, light.height);
                check(Extent { width, height }, &light.data)?;
                super::exr::encode_half(light).map_err(|error| EncodeError(error.to_string()))
            }
        }
    }
}

fn check(extent: Extent, data: &[f32]) -> Result<(), EncodeError> {
    check_values(extent, data).map_err(|text| EncodeError(format!("it {text}")))
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
    let levels = frame.data.iter().map(|value| (value * 255.0).round() as u8);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&levels.collect::<Vec<_>>())?;
    writer.finish()?;
    Ok(bytes)
}
