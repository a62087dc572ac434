//! An encoder together with the way photographs are prepared for it.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use sps_dataset::{DecodeSettings, Frame, FrameError, read_image, read_image_resized};
use sps_models::candle::{Device, Tensor};
use sps_models::encoders::{Embed, Encoder, I3d};

use crate::error::{Error, Result};

/// A network with its weights.
#[derive(Clone, Debug)]
pub enum Network {
    /// Embeds images one by one.
    Images(Encoder),
    /// Embeds sequences of so many images.
    Sequences(I3d, usize),
}

impl Network {
    fn embed_any(&self) -> &dyn Embed {
        match self {
            Self::Images(encoder) => encoder,
            Self::Sequences(network, _) => network,
        }
    }

    /// The network's name.
    pub fn name(&self) -> &'static str {
        self.embed_any().name()
    }

    /// The network where it embeds single images.
    ///
    /// # Errors
    ///
    /// A network of sequences.
    pub fn of_images(&self) -> Result<&Encoder> {
        match self {
            Self::Images(encoder) => Ok(encoder),
            Self::Sequences(..) => Err(Error::input(
                "network",
                format_args!("{}, which embeds sequences", I3d::NAME),
                "an encoder of single images",
            )),
        }
    }

    /// Images that are embedded as one.
    pub fn frames(&self) -> usize {
        match self {
            Self::Images(_) => 1,
            Self::Sequences(_, frames) => *frames,
        }
    }

    /// The length of an embedding.
    pub fn width(&self) -> usize {
        self.embed_any().width()
    }

    /// A hash of the network and every weight.
    pub fn content_hash(&self) -> [u8; 32] {
        self.embed_any().content_hash()
    }

    /// Multiply-adds to embed an image of this size, where they are known.
    pub fn multiply_adds(&self, height: usize, width: usize) -> Option<u64> {
        match self {
            Self::Images(encoder) => encoder.kind().multiply_adds(height, width),
            Self::Sequences(..) => None,
        }
    }

    /// Embeds `n * frames` images, each `(height, width, 3)`, row-major, to `(n, width)`.
    fn embed(&self, images: &[&[f32]], size: [usize; 2]) -> Result<Vec<f32>> {
        match self {
            Self::Images(encoder) => Ok(encoder.embed_pixels(images, size)?),
            Self::Sequences(network, frames) => {
                let [height, width] = size;
                let shape = (images.len() / frames, *frames, height, width, 3);
                let sequences = Tensor::from_vec(images.concat(), shape, &Device::Cpu);
                let sequences = sequences.and_then(|all| all.permute((0, 4, 1, 2, 3)));
                let embeddings = network.embed(&sequences.map_err(sps_models::Error::from)?)?;
                let values = embeddings.flatten_all().and_then(|all| all.to_vec1());
                Ok(values.map_err(sps_models::Error::from)?)
            }
        }
    }
}

/// Turns photographs into embeddings.
///
/// ```
/// use sps_dataset::Frame;
/// use sps_estimator::{Embedder, Network};
/// use sps_models::{candle::Device, encoders::{Encoder, EncoderKind}};
///
/// let encoder = Encoder::seeded(EncoderKind::SeResNextSmall, 0, &Device::Cpu)?;
/// let embedder = Embedder::new(Network::Images(encoder), Some(64))?;
/// let photograph = Frame { width: 200, height: 100, data: vec![0.5; 3 * 200 * 100] };
/// assert_eq!(embedder.embed(&[photograph])?.len(), embedder.width());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Embedder {
    network: Network,
    resize: Option<usize>,
    identity: String,
}

impl Embedder {
    /// Uses `network` on photographs whose shorter side is first brought to `resize` pixels, or on
    /// photographs as they are.
    ///
    /// # Errors
    ///
    /// A size of no pixel, a network that gives numbers that are not finite.
    pub fn new(network: Network, resize: Option<usize>) -> Result<Self> {
        if resize == Some(0) {
            return Err(Error::input("resize", 0, "at least a pixel"));
        }
        let mut embedder = Self {
            network,
            resize,
            identity: String::new(),
        };
        embedder.identity = embedder.find_identity()?;
        Ok(embedder)
    }

    /// The network.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// What the shorter side of every photograph is brought to, in pixels.
    pub fn resize(&self) -> Option<usize> {
        self.resize
    }

    /// The length of an embedding.
    pub fn width(&self) -> usize {
        self.network.width()
    }

    /// A name that two embedders share only if they give every photograph the same embedding, bit for
    /// bit: it hashes the weights, the preparation, and the embedding of a test image, which
    /// differs where the network's code or the processor's instructions round differently.
    pub fn identity(&self) -> &str {
        &self.identity
    }

    /// Multiply-adds to embed the photograph, where they are known.
    pub fn multiply_adds(&self, frame: &Frame) -> Option<u64> {
        let extent = match self.resize {
            Some(shorter) => frame.extent().with_shorter_side(shorter),
            None => frame.extent(),
        };
        self.network.multiply_adds(extent.height, extent.width)
    }

    fn find_identity(&self) -> Result<String> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.network.content_hash());
        hasher.update(format!("{:?}", self.resize).as_bytes());
        for value in self.embed(&[test_frame(self.network.frames())])? {
            hasher.update(&value.to_le_bytes());
        }
        let hash = hasher.finalize().to_hex();
        Ok(format!("{}-{}", self.network.name(), &hash[..16]))
    }

    /// Embeds photographs in the order given, of any sizes: (photographs, width), row-major. For a
    /// network of sequences each is one sequence, its images one below the other.
    ///
    /// # Errors
    ///
    /// A photograph that is too small for the network or lacks pixels; an embedding that is not finite.
    pub fn embed(&self, frames: &[Frame]) -> Result<Vec<f32>> {
        self.embed_each(&frames.iter().collect::<Vec<_>>())
    }

    /// As [`Embedder::embed`], of photographs that lie apart.
    ///
    /// # Errors
    ///
    /// As [`Embedder::embed`].
    pub fn embed_each(&self, frames: &[&Frame]) -> Result<Vec<f32>> {
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
            let embedded = self.network.embed(&images, size)?;
            for (&index, row) in indices.iter().zip(embedded.chunks_exact(width)) {
                values[index * width..][..width].copy_from_slice(row);
            }
        }
        match values.iter().find(|value| !value.is_finite()) {
            None => Ok(values),
            Some(value) => Err(Error::input(
                format_args!("an embedding by {}", self.network.name()),
                value,
                "finite numbers",
            )),
        }
    }

    /// The images that the frame holds, all of one size, as the network takes them; at least one.
    fn prepared<'f>(&self, frame: &'f Frame) -> Result<Vec<Cow<'f, Frame>>> {
        let count = self.network.frames();
        if count == 1 {
            return Ok(vec![self.prepare(frame)?]);
        }
        let (width, height) = (frame.width, frame.height / count);
        let images = frame.data.chunks_exact((width * height * 3).max(1));
        let image = |data: &[f32]| {
            let image = Frame {
                width,
                height,
                data: data.to_vec(),
            };
            Ok(Cow::Owned(self.prepare(&image)?.into_owned()))
        };
        let images = images.map(image).collect::<Result<Vec<_>>>()?;
        if images.len() == count {
            return Ok(images);
        }
        let found = format!("{} images", images.len());
        Err(Error::input(
            "a sequence",
            found,
            format!("{count} of one size"),
        ))
    }

    /// The photograph as the network takes it.
    fn prepare<'f>(&self, frame: &'f Frame) -> Result<Cow<'f, Frame>> {
        match self.resize {
            Some(shorter) => Ok(frame.resized(shorter)?),
            None => Ok(Cow::Borrowed(frame)),
        }
    }
}

/// Reads a photograph, its shorter side brought to so many pixels where any are given.
///
/// # Errors
///
/// What [`read_image`] says.
pub fn read_photograph(
    path: &Path,
    decode: &DecodeSettings,
    shorter_side: Option<usize>,
) -> Result<Frame, FrameError> {
    let decoded = match shorter_side {
        Some(pixels) => read_image_resized(path, decode, pixels)?,
        None => read_image(path, decode)?,
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
