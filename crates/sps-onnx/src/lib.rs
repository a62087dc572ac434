//! Embeddings of images by an ONNX file: the outputs of the network in it, each a block of the embedding. A
//! file is read and run by [rten](https://docs.rs/rten), which is Rust throughout.
//!
//! ```
//! use sps_onnx::{OnnxEncoder, Settings};
//!
//! let settings = Settings { size: Some(224), ..Settings::default() };
//! let error = OnnxEncoder::new("dino.onnx", b"not a network".as_slice(), settings).unwrap_err();
//! assert!(error.to_string().starts_with("dino.onnx: "));
//! ```
//!
//! # What a file may be
//!
//! It takes one input, `(batch, 3, size, size)`, f32. An output is f32 as well: `(1, width)` is taken as it is,
//! of `(1, tokens, width)` the mean over all tokens, of `(1, channels, height, width)` the mean of each channel.
//!
//! Any file is answered with an encoder or an error. One of more than 2 GiB is not read; lengths and the number
//! of parts are checked before memory is taken for them; a graph within a graph, weights in another file, and
//! whole numbers above 2^14 (a size, a padding) are refused. A panic of the library that runs the network
//! becomes an error, although its message still goes to where the program sends such messages. What a network
//! computes is not bounded: a file can be made, as a program can, that asks for more memory or time than there
//! is.
//!
//! # Feature
//!
//! `onnx` reads and runs files. Without it each is refused with [`ErrorKind::NotBuilt`].

mod error;
#[cfg_attr(feature = "onnx", path = "graph.rs")]
#[cfg_attr(not(feature = "onnx"), path = "no_graph.rs")]
mod graph;
#[cfg(feature = "onnx")]
mod limits;

use std::fmt;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use error::{ErrorKind, OnnxError};
use graph::Graph;
pub use sps_base::Unexpected;

/// Bytes of a file at most: what a message of Protocol Buffers may have.
const MOST_BYTES: u64 = i32::MAX as u64;
/// Pixels of an image's side at most.
const LARGEST: usize = 4096;

/// How a network is used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Settings {
    /// The outputs that make an embedding, side by side; none: all that the file has.
    pub outputs: Vec<String>,
    /// Height and width of the images that the network takes, in pixels; none: what the file says.
    pub size: Option<usize>,
    /// The mean of each channel (red, green, blue), which is taken from values in 0..=1.
    pub mean: [f32; 3],
    /// The standard deviation of each channel, by which they are divided then.
    pub std: [f32; 3],
}

impl Default for Settings {
    /// All outputs, the file's size, and ImageNet's mean and standard deviation.
    fn default() -> Self {
        Self {
            outputs: Vec::new(),
            size: None,
            mean: [0.485, 0.456, 0.406],
            std: [0.229, 0.224, 0.225],
        }
    }
}

/// A network from an ONNX file. Clones share it.
#[derive(Clone)]
pub struct OnnxEncoder {
    file: String,
    bytes: Arc<[u8]>,
    settings: Settings,
    size: usize,
    blocks: Vec<(String, usize)>,
    graph: Arc<Graph>,
}

impl OnnxEncoder {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read or has more than 2 GiB; what [`OnnxEncoder::new`] says.
    pub fn read(path: &Path, settings: Settings) -> Result<Self, OnnxError> {
        let bytes = || {
            checked_length(fs::metadata(path)?.len())?;
            Ok(fs::read(path)?)
        };
        let bytes = bytes().map_err(|kind| OnnxError::new(&path.to_string_lossy(), kind))?;
        let name = path.file_name().unwrap_or(path.as_os_str());
        Self::new(&name.to_string_lossy(), bytes, settings)
    }

    /// Takes the bytes of a file, called `file` in messages, and runs the network once, on a black image.
    /// It will run on as many threads as rayon has now.
    ///
    /// # Errors
    /// Without the feature `onnx`, any file. With it: what is no ONNX file, goes beyond the limits or cannot be
    /// run, an operator that is not known, by its name; another input than the crate's documentation says;
    /// settings that do not fit the file.
    pub fn new(
        file: &str,
        bytes: impl Into<Arc<[u8]>>,
        settings: Settings,
    ) -> Result<Self, OnnxError> {
        let made = Self::make(file, bytes.into(), settings);
        made.map_err(|kind| OnnxError::new(file, kind))
    }

    fn make(file: &str, bytes: Arc<[u8]>, settings: Settings) -> Result<Self, ErrorKind> {
        checked_length(bytes.len() as u64)?;
        let Settings { mean, std, .. } = settings;
        let finite = mean.iter().chain(&std).all(|number| number.is_finite());
        if !finite || std.iter().any(|std| *std <= 0.0) {
            let found = format!("{mean:?} and {std:?}");
            let expected = "finite numbers, deviations above 0";
            return Err(ErrorKind::input("mean and std", found, expected));
        }
        let graph = Graph::load(&bytes, &settings.outputs)?;
        let size = match (settings.size, graph.size()) {
            (Some(asked), Some(own)) if asked != own => {
                let expected = format!("the file's, {own}");
                return Err(ErrorKind::input("size", asked, expected));
            }
            (asked, own) => asked.or(own).ok_or_else(|| {
                let expected = "a number of pixels: the file takes images of any size";
                ErrorKind::input("size", "none", expected)
            })?,
        };
        if !(1..=LARGEST).contains(&size) {
            let expected = format!("1 to {LARGEST}");
            return Err(ErrorKind::input("size", size, expected));
        }
        let mut encoder = Self {
            file: file.to_owned(),
            bytes,
            settings,
            size,
            blocks: Vec::new(),
            graph: Arc::new(graph),
        };
        let black = encoder.planes(&vec![0.0; 3 * size * size], [size; 2]);
        let images = encoder.graph.each(1, size, |_| black.clone())?;
        let widths = images.iter().flatten().map(Vec::len);
        let names = encoder.graph.outputs().into_iter();
        encoder.blocks = names.zip(widths).collect();
        if encoder.blocks.is_empty() || encoder.width() == 0 {
            return Err(ErrorKind::input("outputs", "no number", "an embedding"));
        }
        Ok(encoder)
    }

    /// The file's name.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// The file's content.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// How the network is used.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Height and width of the images that the network takes, in pixels.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Name and width of each block of an embedding, in their order: the outputs.
    pub fn blocks(&self) -> &[(String, usize)] {
        &self.blocks
    }

    /// The length of an embedding.
    pub fn width(&self) -> usize {
        self.blocks.iter().map(|(_, width)| width).sum()
    }

    /// Embeds images, each `(height, width, 3)` row-major, f32 in 0..=1, display-referred RGB, to
    /// `(images, width)`, row-major. Of a larger image the network sees the square in its middle.
    ///
    /// Each image goes through the network by itself, so that no other changes its embedding.
    ///
    /// # Errors
    /// An image without its pixels, or smaller than the network takes; what the network cannot compute.
    pub fn embed(&self, images: &[&[f32]], size: [usize; 2]) -> Result<Vec<f32>, OnnxError> {
        let embedded = self.embedded(images, size);
        embedded.map_err(|kind| OnnxError::new(&self.file, kind))
    }

    fn embedded(&self, images: &[&[f32]], size: [usize; 2]) -> Result<Vec<f32>, ErrorKind> {
        let [height, width] = size;
        let pixels = height.checked_mul(width).and_then(|n| n.checked_mul(3));
        let filled = images.iter().all(|image| Some(image.len()) == pixels);
        if !filled || height.min(width) < self.size {
            let found = format!("{height} x {width} pixels");
            let expected = format!("that many, and sides of at least {}", self.size);
            return Err(ErrorKind::input("an image", found, expected));
        }
        let planes = |at: usize| self.planes(images[at], size);
        let rows = self.graph.each(images.len(), self.size, planes)?;
        let mut values = Vec::with_capacity(images.len() * self.width());
        for outputs in rows {
            let widths = outputs.iter().map(Vec::len);
            if !widths.eq(self.blocks.iter().map(|(_, width)| *width)) {
                let expected = "as many numbers for each image";
                return Err(ErrorKind::input("outputs", "other widths", expected));
            }
            values.extend(outputs.into_iter().flatten());
        }
        Ok(values)
    }

    /// The square in the middle of an image as the network takes it, `(3, size, size)`.
    fn planes(&self, image: &[f32], [height, width]: [usize; 2]) -> Vec<f32> {
        let (top, left) = ((height - self.size) / 2, (width - self.size) / 2);
        let Settings { mean, std, .. } = self.settings;
        let mut planes = Vec::with_capacity(3 * self.size * self.size);
        for channel in 0..3 {
            for y in top..top + self.size {
                let row = &image[3 * (y * width + left)..][..3 * self.size];
                let values = row.iter().skip(channel).step_by(3);
                planes.extend(values.map(|value| (value - mean[channel]) / std[channel]));
            }
        }
        planes
    }
}

impl fmt::Debug for OnnxEncoder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OnnxEncoder")
            .field("file", &self.file)
            .field("settings", &self.settings)
            .field("blocks", &self.blocks)
            .finish_non_exhaustive()
    }
}

fn checked_length(bytes: u64) -> Result<(), ErrorKind> {
    if bytes <= MOST_BYTES {
        return Ok(());
    }
    let expected = format!("at most {MOST_BYTES}");
    Err(ErrorKind::input("bytes", bytes, expected))
}
