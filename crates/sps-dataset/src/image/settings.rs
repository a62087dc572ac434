use std::fmt::Debug;

use serde::{Deserialize, Deserializer, Serialize, de};

/// How image files become [`Frame`](crate::Frame)s.
///
/// Every setting that changes pixels is part of a frame's key, so a cache keyed by it never mixes
/// two of them up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct DecodeSettings {
    /// EXR only: stops by which linear light is brightened before it is clipped, finite. Default 0.
    #[serde(deserialize_with = "finite")]
    pub exposure_stops: f32,
    /// EXR only: what is done with NaN and infinite samples. Default `replace`.
    pub non_finite: NonFinite,
    /// EXR only: the layer or part to read. Default: the unnamed one, else the only one.
    pub exr_layer: Option<String>,
    /// PNG only: the display-referred colour, each in `[0, 1]`, that shows through transparent
    /// pixels. Default white.
    #[serde(deserialize_with = "colour")]
    pub background: [f32; 3],
    /// What a file may ask for at most.
    pub limits: Limits,
}

/// What is done with NaN and infinite samples of an EXR.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NonFinite {
    /// NaN and minus infinity become black, plus infinity white; they are counted.
    #[default]
    Replace,
    /// The frame is an error.
    Reject,
}

/// What an image file may ask for at most, whatever its header says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Limits {
    /// Bytes of an image file. Default 512 MiB.
    pub file_bytes: u64,
    /// Pixels of an image. Default 2^25, for example 8192 x 4096, which keeps the memory for one
    /// frame below 1 GiB. A block of an EXR may unpack to 4 bytes per allowed pixel.
    pub pixels: u64,
}

impl Default for DecodeSettings {
    fn default() -> Self {
        Self {
            exposure_stops: 0.0,
            non_finite: NonFinite::default(),
            exr_layer: None,
            background: [1.0; 3],
            limits: Limits::default(),
        }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            file_bytes: 512 << 20,
            pixels: 1 << 25,
        }
    }
}

impl DecodeSettings {
    /// The settings that change pixels, as bytes that differ whenever one of them does.
    pub(crate) fn key(&self) -> Vec<u8> {
        let mut key = self.exposure_stops.to_le_bytes().to_vec();
        key.push(u8::from(self.non_finite == NonFinite::Reject));
        key.extend(self.background.iter().flat_map(|value| value.to_le_bytes()));
        if let Some(layer) = &self.exr_layer {
            key.push(1);
            key.extend(layer.as_bytes());
        }
        key
    }
}

fn finite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    let value = f32::deserialize(deserializer)?;
    checked(value, value.is_finite(), "a finite number")
}

fn colour<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f32; 3], D::Error> {
    let colour = <[f32; 3]>::deserialize(deserializer)?;
    let shares = colour.iter().all(|value| (0.0..=1.0).contains(value));
    checked(colour, shares, "three shares from 0 to 1")
}

fn checked<T: Debug, E: de::Error>(value: T, holds: bool, expected: &str) -> Result<T, E> {
    if holds {
        return Ok(value);
    }
    Err(E::custom(format!("found {value:?}, expected {expected}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse_toml;

    #[test]
    fn settings_are_checked_where_they_are_read() {
        let read = |text: &str| {
            let settings = parse_toml::<DecodeSettings>("run.toml".as_ref(), text);
            settings.map(drop).map_err(|error| error.to_string())
        };
        let sound = "exposure-stops = -2\nbackground = [0, 0.5, 1]";
        assert_eq!(read(sound), Ok(()));
        for (text, refusal) in [
            (
                "exposure-stops = inf",
                "1: is not valid TOML: found inf, expected a finite number",
            ),
            (
                "\nbackground = [0, 255, 0]",
                "2: is not valid TOML: found [0.0, 255.0, 0.0], expected three shares from 0 to 1",
            ),
            (
                "[limits]\npixel = 3",
                "2: unknown key `pixel`, did you mean `pixels`? Expected one of `file-bytes`, `pixels`",
            ),
        ] {
            assert_eq!(read(text), Err(format!("run.toml, line {refusal}")));
        }
    }
}
