//! An encoder together with the way frames are prepared for it.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, ensure};
use sps_dataset::{
    DecodeSettings, Frame, FrameError, FrameErrorKind, read_image, read_image_resized,
};

use crate::encoder::Loaded;

/// Turns frames into embeddings.
pub(crate) struct Embedder {
    encoder: Loaded,
    resize: Option<usize>,
    identity: String,
}

impl Embedder {
    /// Uses `encoder` on frames whose shorter side is first brought to `resize` pixels, or on
    /// frames as they are.
    pub(crate) fn new(encoder: Loaded, resize: Option<usize>) -> Result<Self> {
        let mut embedder = Self {
            encoder,
            resize,
            identity: String::new(),
        };
        embedder.identity = embedder.find_identity()?;
        Ok(embedder)
    }

    /// The network.
    pub(crate) fn encoder(&self) -> &Loaded {
        &self.encoder
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

    /// Multiply-adds to embed the frame, where they are known.
    pub(crate) fn multiply_adds(&self, frame: &Frame) -> Option<u64> {
        let extent = frame.extent();
        let extent = self
            .resize
            .map_or(extent, |pixels| extent.with_shorter_side(pixels));
        self.encoder.multiply_adds(extent.height, extent.width)
    }

    fn find_identity(&self) -> Result<String> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.encoder.content_hash());
        hasher.update(format!("{:?}", self.resize).as_bytes());
        for value in self.embed(&[test_frame(self.encoder.frames())])? {
            hasher.update(&value.to_le_bytes());
        }
        let hash = hasher.finalize().to_hex();
        Ok(format!("{}-{}", self.encoder.name(), &hash[..16]))
    }

    /// Embeds frames in the order given: (frames, width), row-major. For an encoder of sequences
    /// a frame is one sequence, its images one below the other.
    pub(crate) fn embed(&self, frames: &[Frame]) -> Result<Vec<f32>> {
        let mut by_size: BTreeMap<[usize; 2], Vec<usize>> = BTreeMap::new();
        let prepared = frames.iter().map(|frame| self.prepared(frame));
        let prepared = prepared.collect::<Result<Vec<_>>>()?;
        for (index, images) in prepared.iter().enumerate() {
            let size = [images[0].height, images[0].width];
            by_size.entry(size).or_default().push(index);
        }
        let width = self.width();
        let mut values = vec![0.0; frames.len() * width];
        for (size, indices) in by_size {
            let images = indices.iter().flat_map(|&index| &prepared[index]);
            let images: Vec<&[f32]> = images.map(|image| &image.data[..]).collect();
            let embedded = self.encoder.embed(&images, size)?;
            for (&index, row) in indices.iter().zip(embedded.chunks_exact(width)) {
                values[index * width..][..width].copy_from_slice(row);
            }
        }
        ensure!(
            values.iter().all(|value| value.is_finite()),
            "the encoder {} gave an embedding that is not finite",
            self.encoder.name()
        );
        Ok(values)
    }

    /// The images that the frame holds, all of one size, as the encoder takes them.
    fn prepared<'f>(&self, frame: &'f Frame) -> Result<Vec<Cow<'f, Frame>>> {
        let count = self.encoder.frames();
        if count == 1 {
            return Ok(vec![prepare(frame, self.resize)?]);
        }
        let (width, height) = (frame.width, frame.height / count);
        let images = frame.data.chunks_exact((width * height * 3).max(1));
        let image = |data: &[f32]| {
            let image = Frame {
                width,
                height,
                data: data.to_vec(),
            };
            Ok(Cow::Owned(prepare(&image, self.resize)?.into_owned()))
        };
        let images = images.map(image).collect::<Result<Vec<_>>>()?;
        ensure!(
            images.len() == count,
            "a sequence of {} images, expected {count} of one size",
            images.len()
        );
        Ok(images)
    }
}

/// The frame as an encoder takes it: its shorter side brought to `resize` pixels.
pub(crate) fn prepare(
    frame: &Frame,
    resize: Option<usize>,
) -> Result<Cow<'_, Frame>, FrameErrorKind> {
    resize.map_or(Ok(Cow::Borrowed(frame)), |pixels| frame.resized(pixels))
}

/// Reads a photograph as an encoder takes it: its shorter side brought to `resize` pixels.
pub(crate) fn read_prepared(
    path: &Path,
    settings: &DecodeSettings,
    resize: Option<usize>,
) -> Result<Frame, FrameError> {
    let decoded = match resize {
        Some(pixels) => read_image_resized(path, settings, pixels)?,
        None => read_image(path, settings)?,
    };
    Ok(decoded.frame)
}

/// Images of 64 x 64 pixels, one below the other, of every brightness and many gradients.
fn test_frame(images: usize) -> Frame {
    const SIDE: usize = 64;
    let value = |i: usize| ((i * i * 31 + i * 17) % 255) as f32 / 254.0;
    Frame {
        width: SIDE,
        height: images * SIDE,
        data: (0..images * SIDE * SIDE * 3).map(value).collect(),
    }
}
