//! An encoder together with the way photographs are prepared for it.

use std::borrow::{Borrow, Cow};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use sps_dataset::{
    DecodeSettings, Extent, Frame, FrameError, PHOTOGRAPH_ENDINGS, photograph_ending,
    read_image_resized,
};
use sps_models::encoders::{Block, Encoder};
use sps_onnx::OnnxEncoder;
use sps_regress::Embeddings;

use crate::error::{Error, Result, refuse};
use crate::precomputed::Precomputed;

/// What embeddings come from.
#[derive(Clone, Debug)]
pub enum Network {
    /// Embeds images one by one.
    Images(Encoder),
    /// Embeds sequences of so many images.
    Sequences(Encoder, usize),
    /// A network in an ONNX file, which embeds images one by one.
    Onnx(OnnxEncoder),
    /// No network: embeddings were computed elsewhere.
    Precomputed(Arc<Precomputed>),
}

impl Network {
    /// The encoder, where it is one of those that the project knows by name.
    ///
    /// # Errors
    /// A network from elsewhere, or none.
    pub fn encoder(&self) -> Result<&Encoder> {
        match self {
            Self::Images(encoder) | Self::Sequences(encoder, _) => Ok(encoder),
            other => refuse("encoder", other.name(), "one that is known by name"),
        }
    }

    /// The same with another encoder.
    #[must_use]
    pub fn with_encoder(&self, encoder: Encoder) -> Self {
        match self {
            Self::Sequences(_, frames) => Self::Sequences(encoder, *frames),
            _ => Self::Images(encoder),
        }
    }

    /// What it is called: the encoder's name, that of the ONNX file, or `precomputed`.
    pub fn name(&self) -> &str {
        match self {
            Self::Images(encoder) | Self::Sequences(encoder, _) => encoder.kind().name(),
            Self::Onnx(encoder) => encoder.file(),
            Self::Precomputed(_) => PRECOMPUTED,
        }
    }

    /// The blocks of an embedding, in their order.
    pub fn blocks(&self) -> Vec<Block> {
        match self {
            Self::Images(encoder) | Self::Sequences(encoder, _) => encoder.blocks(),
            Self::Onnx(encoder) => {
                let blocks = encoder.blocks().iter().cloned();
                blocks.map(|(name, width)| Block { name, width }).collect()
            }
            Self::Precomputed(rows) => rows.blocks().to_vec(),
        }
    }

    /// The length of an embedding.
    pub fn width(&self) -> usize {
        match self {
            Self::Images(encoder) | Self::Sequences(encoder, _) => encoder.width(),
            Self::Onnx(encoder) => encoder.width(),
            Self::Precomputed(rows) => rows.width(),
        }
    }

    /// Images that are embedded as one.
    pub fn frames(&self) -> usize {
        match self {
            Self::Sequences(_, frames) => *frames,
            _ => 1,
        }
    }

    /// Embeds prepared images of one size.
    fn embed_pixels(&self, images: &[&[f32]], size: [usize; 2]) -> Result<Vec<f32>> {
        match self {
            Self::Images(encoder) | Self::Sequences(encoder, _) => {
                Ok(encoder.embed_pixels(images, size)?)
            }
            Self::Onnx(encoder) => Ok(encoder.embed(images, size)?),
            Self::Precomputed(_) => refuse(
                "photographs",
                "images",
                "their embeddings, computed as those that the model was fitted on",
            ),
        }
    }
}

/// The name of embeddings that no encoder here made.
pub(crate) const PRECOMPUTED: &str = "precomputed";

/// Turns photographs into embeddings.
///
/// ```
/// use sps_dataset::Frame;
/// use sps_estimator::{Embedder, Network};
/// use sps_models::encoders::{Encoder, EncoderKind};
///
/// let encoder = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?;
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
    /// photographs as they are. A network in an ONNX file takes squares of one size: without `resize`, the
    /// shorter side is brought to that; the square in the middle is what it sees.
    ///
    /// # Errors
    /// A size of no pixel, sequences of no image, a network that gives numbers that are not finite.
    pub fn new(network: Network, resize: Option<usize>) -> Result<Self> {
        let resize = match &network {
            Network::Onnx(encoder) => resize.or(Some(encoder.size())),
            _ => resize,
        };
        if resize == Some(0) {
            return refuse("resize", 0, "at least a pixel");
        }
        if network.frames() == 0 {
            return refuse("a sequence", "no image", "at least one");
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
    /// bit, or if neither embeds any: it hashes the weights, the preparation, and the embedding of a test image, which
    /// differs where the network's code or the processor's instructions round differently.
    pub fn identity(&self) -> &str {
        &self.identity
    }

    /// Multiply-adds to embed the photograph, as [`Embedder::embed`] takes it; `None` where it is too
    /// small, or the encoder is none of those known by name.
    pub fn multiply_adds(&self, frame: &Frame) -> Option<u64> {
        let frames = self.network.frames();
        let image = Extent {
            height: frame.height / frames,
            ..frame.extent()
        };
        let image = match self.resize {
            Some(shorter) => image.with_shorter_side(shorter),
            None => image,
        };
        let size = [frames, image.height, image.width];
        self.network.encoder().ok()?.multiply_adds(size)
    }

    fn find_identity(&self) -> Result<String> {
        let mut hasher = blake3::Hasher::new();
        match &self.network {
            Network::Images(encoder) | Network::Sequences(encoder, _) => {
                hasher.update(&encoder.content_hash());
            }
            Network::Onnx(encoder) => {
                hasher.update(encoder.bytes());
                hasher.update(format!("{:?}", encoder.settings()).as_bytes());
            }
            Network::Precomputed(_) => return Ok(PRECOMPUTED.to_owned()),
        }
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
    /// A photograph that is too small for the network or lacks pixels; an embedding that is not finite.
    pub fn embed<F: Borrow<Frame>>(&self, frames: &[F]) -> Result<Vec<f32>> {
        let mut by_size: BTreeMap<[usize; 2], Vec<usize>> = BTreeMap::new();
        let prepared = frames.iter().map(|frame| self.prepared(frame.borrow()));
        let prepared = prepared.collect::<Result<Vec<_>>>()?;
        for (index, images) in prepared.iter().enumerate() {
            let size = [images.height / self.network.frames(), images.width];
            by_size.entry(size).or_default().push(index);
        }
        let width = self.width();
        let mut values = vec![0.0; frames.len() * width];
        for (size, indices) in by_size {
            let images = indices.iter().map(|&index| &prepared[index].data[..]);
            let images: Vec<&[f32]> = images.collect();
            let embedded = self.network.embed_pixels(&images, size)?;
            for (&index, row) in indices.iter().zip(embedded.chunks_exact(width)) {
                values[index * width..][..width].copy_from_slice(row);
            }
        }
        match values.iter().find(|value| !value.is_finite()) {
            None => Ok(values),
            Some(value) => refuse(
                format_args!("an embedding by {}", self.network.name()),
                value,
                "finite numbers",
            ),
        }
    }

    /// A frame of [`Embedder::embed`] as the network takes it: every image that it holds brought to size,
    /// one below the other.
    ///
    /// # Errors
    /// A frame that lacks pixels, or is not of as many images as a sequence has.
    pub fn prepared<'f>(&self, frame: &'f Frame) -> Result<Cow<'f, Frame>> {
        let count = self.network.frames();
        if count == 1 {
            return self.prepare(frame);
        }
        let (width, height) = (frame.width, frame.height / count);
        let images = frame.data.chunks_exact((width * height * 3).max(1));
        if images.len() != count {
            let found = format!("{} images", images.len());
            let expected = format!("{count} of one size");
            return refuse("a sequence", found, expected);
        }
        let mut prepared = Frame {
            width: 0,
            height: 0,
            data: Vec::new(),
        };
        for data in images {
            let image = Frame {
                width,
                height,
                data: data.to_vec(),
            };
            let image = self.prepare(&image)?;
            prepared.width = image.width;
            prepared.height += image.height;
            prepared.data.extend_from_slice(&image.data);
        }
        Ok(Cow::Owned(prepared))
    }

    /// The embeddings of surfaces, `(surfaces, views, width)`, as a table with the blocks of the encoder's
    /// depths.
    ///
    /// # Errors
    /// Another number of values, or one that is not finite.
    pub fn table(&self, values: &[f32], surfaces: usize, views: usize) -> Result<Embeddings> {
        let table = Embeddings::new(values.to_vec(), [surfaces, views, self.width()])?;
        let blocks = self.network.blocks();
        let widths: Vec<usize> = blocks.iter().map(|block| block.width).collect();
        Ok(table.in_blocks(&widths)?)
    }

    /// The photograph as the network takes it.
    fn prepare<'f>(&self, frame: &'f Frame) -> Result<Cow<'f, Frame>> {
        match self.resize {
            Some(shorter) => Ok(frame.resized(shorter)?),
            None => Ok(Cow::Borrowed(frame)),
        }
    }
}

/// The photographs in a folder, by name: PNG, JPEG and EXR.
///
/// # Errors
/// A folder that cannot be read, or holds none.
pub fn photographs_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let failed = Error::file(folder);
    let (mut photographs, mut folders) = (Vec::new(), 0);
    for entry in fs::read_dir(folder).map_err(&failed)? {
        let path = entry.map_err(&failed)?.path();
        if path.is_dir() {
            folders += 1;
        } else if photograph_ending(&path).is_some() {
            photographs.push(path);
        }
    }
    if photographs.is_empty() {
        let mut expected = format!("files that end in {}", PHOTOGRAPH_ENDINGS.join(", "));
        if folders > 0 {
            let each = folder.join("*").display().to_string();
            let instead = format!("it holds folders ({folders}): name them instead, {each}");
            expected = format!("{expected}; {instead}");
        }
        return refuse(folder.display(), "no photograph", expected);
    }
    photographs.sort();
    Ok(photographs)
}

/// Reads a photograph, its shorter side brought to so many pixels where any are given.
///
/// # Errors
/// What [`read_image_resized`] says.
pub fn read_photograph(
    path: &Path,
    decode: &DecodeSettings,
    shorter_side: Option<usize>,
) -> Result<Frame, FrameError> {
    Ok(read_image_resized(path, decode, shorter_side)?.frame)
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
