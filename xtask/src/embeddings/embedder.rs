//! An encoder together with the way frames are prepared for it.

use std::borrow::Cow;
use std::collections::BTreeMap;

use anyhow::{Context, Result, ensure};
use candle_core::{Device, Tensor};
use image::Rgb32FImage;
use image::imageops::{self, FilterType};
use sps_dataset::{Frame, Limits};
use sps_models::encoders::Encoder;

/// Turns frames into embeddings.
pub(crate) struct Embedder {
    encoder: Encoder,
    resize: Option<usize>,
    identity: String,
}

impl Embedder {
    /// Uses `encoder` on frames whose shorter side is first brought to `resize` pixels, or on
    /// frames as they are.
    pub(crate) fn new(encoder: Encoder, resize: Option<usize>) -> Result<Self> {
        let mut embedder = Self {
            encoder,
            resize,
            identity: String::new(),
        };
        embedder.identity = embedder.find_identity()?;
        Ok(embedder)
    }

    /// The length of an embedding.
    pub(crate) fn width(&self) -> usize {
        self.encoder.width()
    }

    /// A name that two embedders share only if they give every frame the same embedding, bit for
    /// bit: it hashes the weights, the preparation, and the embedding of a test frame, which
    /// differs where the network's code or the processor's instructions round differently.
    pub(crate) fn identity(&self) -> &str {
        &self.identity
    }

    /// Multiply-adds to embed the frame.
    pub(crate) fn multiply_adds(&self, frame: &Frame) -> Option<u64> {
        let (width, height) = prepared_size(frame, self.resize);
        self.encoder.kind().multiply_adds(height, width)
    }

    fn find_identity(&self) -> Result<String> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.encoder.content_hash());
        hasher.update(format!("{:?}", self.resize).as_bytes());
        for value in self.embed(&[test_frame()])? {
            hasher.update(&value.to_le_bytes());
        }
        let hash = hasher.finalize().to_hex();
        Ok(format!("{}-{}", self.encoder.kind(), &hash[..16]))
    }

    /// Embeds frames in the order given: (frames, width), row-major.
    pub(crate) fn embed(&self, frames: &[Frame]) -> Result<Vec<f32>> {
        let mut by_size: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
        let prepared = frames.iter().map(|frame| prepare(frame, self.resize));
        let prepared = prepared.collect::<Result<Vec<_>>>()?;
        for (index, frame) in prepared.iter().enumerate() {
            let size = (frame.height, frame.width);
            by_size.entry(size).or_default().push(index);
        }
        let width = self.width();
        let mut values = vec![0.0; frames.len() * width];
        for ((height, columns), indices) in by_size {
            let pixels: Vec<f32> = indices
                .iter()
                .flat_map(|&index| prepared[index].data.iter().copied())
                .collect();
            let images =
                Tensor::from_vec(pixels, (indices.len(), height, columns, 3), &Device::Cpu)?;
            let embedded = self.encoder.embed(&images.permute((0, 3, 1, 2))?)?;
            let embedded = embedded.flatten_all()?.to_vec1::<f32>()?;
            for (&index, row) in indices.iter().zip(embedded.chunks_exact(width)) {
                values[index * width..][..width].copy_from_slice(row);
            }
        }
        ensure!(
            values.iter().all(|value| value.is_finite()),
            "the encoder {} gave an embedding that is not finite",
            self.encoder.kind()
        );
        Ok(values)
    }
}

/// The frame as an encoder takes it: its shorter side brought to `resize` pixels.
pub(crate) fn prepare(frame: &Frame, resize: Option<usize>) -> Result<Cow<'_, Frame>> {
    let (width, height) = prepared_size(frame, resize);
    if (width, height) == (frame.width, frame.height) {
        return Ok(Cow::Borrowed(frame));
    }
    let most = Limits::default().pixels;
    ensure!(
        (width as u64).saturating_mul(height as u64) <= most,
        "a shorter side of {} pixels makes images of {width} x {height}, expected at most {most} pixels",
        width.min(height)
    );
    Ok(Cow::Owned(resized(frame, width, height)?))
}

/// Width and height of the frame as an encoder takes it.
fn prepared_size(frame: &Frame, resize: Option<usize>) -> (usize, usize) {
    let shorter = frame.width.min(frame.height);
    match resize {
        Some(wanted) if wanted != shorter => {
            let scale = wanted as f64 / shorter as f64;
            let side = |length: usize| ((length as f64 * scale).round() as usize).max(1);
            (side(frame.width), side(frame.height))
        }
        _ => (frame.width, frame.height),
    }
}

/// Resampled with a triangle filter as wide as the pixels that it takes together.
fn resized(frame: &Frame, width: usize, height: usize) -> Result<Frame> {
    let size = |length: usize| u32::try_from(length).context("an image of over 2^32 pixels a side");
    let image = Rgb32FImage::from_raw(size(frame.width)?, size(frame.height)?, frame.data.clone())
        .context("a frame whose values do not fill its size")?;
    let image = imageops::resize(&image, size(width)?, size(height)?, FilterType::Triangle);
    Ok(Frame {
        width,
        height,
        data: image.into_raw(),
    })
}

/// 64 x 64 pixels of every brightness and many gradients.
fn test_frame() -> Frame {
    const SIDE: usize = 64;
    let value = |i: usize| ((i * i * 31 + i * 17) % 255) as f32 / 254.0;
    Frame {
        width: SIDE,
        height: SIDE,
        data: (0..SIDE * SIDE * 3).map(value).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_beyond_the_limit_is_refused() {
        assert_eq!(prepare(&test_frame(), Some(32)).unwrap().width, 32);
        for wanted in [5793, 65_536, usize::MAX] {
            let refused = prepare(&test_frame(), Some(wanted)).unwrap_err();
            assert!(refused.to_string().contains("33554432"), "{refused}");
        }
    }
}
