//! Networks that turn an image into an embedding.
//!
//! An embedding is the mean over space of the network's last feature map, or of the maps at several
//! [depths](Depths).

mod init;
mod input;
mod kind;
#[cfg(test)]
mod plain;
mod scales;
#[cfg(test)]
mod tests;
mod trainable;
mod windows;

use std::path::Path;
use std::sync::Arc;

use candle_core::{Device, Tensor};
use sps_kernels::inference::{Inference, calibrate};
use sps_kernels::network::Network;
use sps_kernels::simd::Level;
use sps_kernels::{Images, Order, Size};

pub use kind::EncoderKind;
pub use sps_kernels::inference::Resources;
pub use sps_kernels::network::{Block, Depths};
pub use sps_kernels::{Precision, WindowEmbeddings, Windows};
pub use trainable::TrainableEncoder;

use crate::differentiable::with_values;
use crate::error::{Error, Result};
use crate::weights::{TensorSpec, Weights};
use input::{check, check_pixels};

/// A network with its weights, ready to embed images, or sequences of frames where it
/// [takes those](EncoderKind::takes_sequences).
///
/// ```
/// use candle_core::{DType, Device, Tensor};
/// use sps_models::encoders::{Encoder, EncoderKind};
///
/// let encoder = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?;
/// let images = Tensor::zeros((2, 3, 64, 48), DType::F32, &Device::Cpu)?;
/// assert_eq!(encoder.embed(&images)?.dims(), [2, encoder.width()]);
///
/// let i3d = Encoder::seeded(EncoderKind::I3d, 0)?;
/// let views = Tensor::zeros((1, 3, 4, 40, 32), DType::F32, &Device::Cpu)?;
/// assert_eq!(i3d.embed(&views)?.dims(), [1, i3d.width()]);
/// # Ok::<(), sps_models::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Encoder {
    kind: EncoderKind,
    depths: Depths,
    /// As far as its depths need it.
    network: Arc<Network>,
    precision: Precision,
    weights: Weights,
    hash: blake3::Hash,
    kernels: Inference,
}

impl Encoder {
    /// Reads the network's weights from a file; see [`Weights::read`] for the formats.
    ///
    /// # Errors
    /// When the file cannot be read or does not fit: a missing, extra or misshapen tensor, a
    /// value that is not finite. A classifier's last layer may be in the file and is not used.
    pub fn load(kind: EncoderKind, weights: impl AsRef<Path>) -> Result<Self> {
        Self::new(kind, Weights::read(weights)?)
    }

    /// The network with the weights that come with this crate (`weights/README.md`: how they were made, and their
    /// licence).
    ///
    /// # Errors
    /// An encoder that has none: [`EncoderKind::check_built_in`].
    pub fn built_in(kind: EncoderKind) -> Result<Self> {
        kind.check_built_in()?;
        let bytes = include_bytes!("../../weights/efficientnet-lite-body.safetensors");
        Self::new(kind, Weights::from_bytes("the built-in weights", bytes)?)
    }

    /// A network with untrained weights, the same for the same seed everywhere.
    ///
    /// # Errors
    /// None that is known.
    pub fn seeded(kind: EncoderKind, seed: u64) -> Result<Self> {
        Self::new(kind, init::seeded(&kind.specs(), seed)?)
    }

    /// A network that begins with what another has learnt: it takes each tensor of `weights` that has the
    /// name and the shape of one of its own, and draws the others as [`Encoder::seeded`] does. Their
    /// names stand beside it.
    ///
    /// # Errors
    /// When no tensor has a place in the network.
    pub fn warm_started(
        kind: EncoderKind,
        weights: Weights,
        seed: u64,
    ) -> Result<(Self, Vec<String>)> {
        let (network, specs) = (kind.network(), kind.specs());
        let weights = weights.renamed(|name| network.own_name(name));
        let mut start = init::seeded(&specs, seed)?;
        let mut drawn = Vec::new();
        for TensorSpec { name, shape } in &specs {
            match weights.get(name) {
                Ok(tensor) if tensor.dims() == shape => start.replace(name, tensor.clone()),
                _ => drawn.push(name.clone()),
            }
        }
        if drawn.len() == specs.len() {
            let found = format_args!("{}, no tensor of which {kind} has", weights.origin());
            let expected = "tensors with the names and shapes of the network's";
            return Err(Error::input("weights to start from", found, expected));
        }
        Ok((Self::new(kind, start)?, drawn))
    }

    /// A network with the given weights.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub fn new(kind: EncoderKind, mut weights: Weights) -> Result<Self> {
        let network = kind.network();
        let scales = weights.remove(scales::TENSOR);
        let weights = weights.renamed(|name| network.own_name(name));
        let passes = |name: &str| network.passes(name);
        let mut weights = weights.fit(network.name, &network.specs(), passes)?;
        if let Some(scales) = scales {
            weights.replace(scales::TENSOR, scales);
            scales::read(&network, &weights)?;
        }
        Self::of(kind, Depths::default(), Precision::default(), weights)
    }

    /// A network whose weights have been checked.
    fn of(
        kind: EncoderKind,
        depths: Depths,
        precision: Precision,
        weights: Weights,
    ) -> Result<Self> {
        let network = kind.network().at(&depths)?;
        Ok(Self {
            kind,
            precision,
            kernels: kernels(kind, &network, &weights, precision)?,
            hash: content_hash(&network, &depths, &weights, precision)?,
            weights,
            network: Arc::new(network),
            depths,
        })
    }

    /// The same network with embeddings of other depths: fine structure is in the earlier ones. The layers behind the last of them are not
    /// run.
    ///
    /// ```
    /// use candle_core::{DType, Device, Tensor};
    /// use sps_models::encoders::{Depths, Encoder, EncoderKind};
    ///
    /// let encoder = Encoder::seeded(EncoderKind::ResNet18, 0)?;
    /// let encoder = encoder.with_depths(&Depths::All)?;
    /// let images = Tensor::zeros((2, 3, 64, 48), DType::F32, &Device::Cpu)?;
    /// assert_eq!(encoder.embed(&images)?.dims(), [2, 64 + 128 + 256 + 512]);
    /// assert_eq!(encoder.blocks()[1].name, "stage-2");
    /// # Ok::<(), sps_models::Error>(())
    /// ```
    ///
    /// # Errors
    /// No depth, one that the network does not have, one named twice.
    pub fn with_depths(self, depths: &Depths) -> Result<Self> {
        if *depths == self.depths {
            return Ok(self);
        }
        let resources = self.kernels.resources();
        let of = Self::of(self.kind, depths.clone(), self.precision, self.weights)?;
        Ok(of.with_resources(resources))
    }

    /// The same network with what it needs to compute in int8: how its feature maps are scaled, found on
    /// images like those that it is to embed, in batches as [`Encoder::embed`] takes them. A few dozen
    /// are enough.
    ///
    /// The images go through the network in f32. A map's numbers are then 255 steps from the least to
    /// the largest of its values, 0 among them, after each end was brought nearer to 0 by as many hundredths
    /// as make the squared error of rounding and clipping least over these images: first the upper end,
    /// then the lower one, then the upper one again. The steps join the weights as the tensor `int8.scales`, `(maps, 2)`, and are saved and loaded with
    /// them. Weights need no images: a channel's are 127 steps to the largest.
    ///
    /// ```
    /// use candle_core::{Device, Tensor};
    /// use sps_models::encoders::{Encoder, EncoderKind, Precision};
    ///
    /// let encoder = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?;
    /// let images = Tensor::rand(0.0_f32, 1.0, (2, 3, 64, 64), &Device::Cpu)?;
    /// let encoder = encoder.calibrated(&[&images])?.with_precision(Precision::Int8)?;
    /// assert_eq!(encoder.embed(&images)?.dims(), [2, encoder.width()]);
    /// # Ok::<(), sps_models::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Encoder::embed`]; when there is no image, or one makes a feature map that is not finite.
    pub fn calibrated(mut self, images: &[&Tensor]) -> Result<Self> {
        let network = self.kind.network();
        let values = |images: &&Tensor| -> Result<(Size, Vec<f32>)> {
            let size = check(&self.network, images)?;
            Ok((size, images.flatten_all()?.to_vec1()?))
        };
        let values = images.iter().map(values).collect::<Result<Vec<_>>>()?;
        let each = values.iter();
        let each: Vec<_> = each.map(|(size, all)| Images::each(all, *size)).collect();
        let batches = each.iter().zip(&values).map(|(images, (size, _))| {
            Images::new(images, Order::Planes, *size, network.normalisation)
        });
        let batches = batches.collect::<Result<Vec<_>, _>>()?;
        let scales = calibrate(&network, &self.weights, &batches, Level::detect())?;
        let scales = scales::tensor(&scales)?;
        self.weights.replace(scales::TENSOR, scales);
        let precision = self.precision;
        self.with_precision(precision)
    }

    /// The same network, computing in another precision.
    ///
    /// # Errors
    /// When the precision is int8 and [`Encoder::calibrated`] has not been called, neither for this encoder
    /// nor for that whose weights it has.
    pub fn with_precision(self, precision: Precision) -> Result<Self> {
        let resources = self.kernels.resources();
        let of = Self::of(self.kind, self.depths, precision, self.weights)?;
        Ok(of.with_resources(resources))
    }

    /// The same network, whose passes may take other threads, time and memory.
    ///
    /// ```
    /// use std::time::Duration;
    /// use sps_models::candle::Device;
    /// use sps_models::encoders::{Encoder, EncoderKind, Resources};
    ///
    /// let encoder = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?;
    /// let spin = Duration::ZERO;
    /// let encoder = encoder.with_resources(Resources { threads: 8, spin, memory: 1 << 30 });
    /// encoder.embed_pixels(&[&vec![0.5; 64 * 48 * 3]], [64, 48])?;
    /// encoder.shrink();
    /// # Ok::<(), sps_models::Error>(())
    /// ```
    #[must_use]
    pub fn with_resources(mut self, resources: Resources) -> Self {
        self.kernels = self.kernels.with_resources(resources);
        self
    }

    /// Gives back to the system the memory that is kept for passes to come, for all clones.
    pub fn shrink(&self) {
        self.kernels.shrink();
    }

    /// Which network this is.
    pub fn kind(&self) -> EncoderKind {
        self.kind
    }

    /// What the network computes in.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Which feature maps an embedding is made of.
    pub fn depths(&self) -> &Depths {
        &self.depths
    }

    /// The blocks of an embedding, in their order.
    pub fn blocks(&self) -> Vec<Block> {
        self.network.named_blocks()
    }

    /// The length of an embedding, all blocks together.
    pub fn width(&self) -> usize {
        self.network.width()
    }

    /// [`EncoderKind::multiply_adds`] of the layers that this embedding needs.
    pub fn multiply_adds(&self, size: [usize; 3]) -> Option<u64> {
        self.network.multiply_adds(size)
    }

    /// The network's weights.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// A hash of the network's name, its depths, its precision, every weight and the way sums are rounded on this
    /// processor, for cache keys: two encoders with one hash give the same embeddings.
    ///
    /// bf16 by the processor's own instructions and without them are two ways, as are f32 with fused
    /// multiply-add and without. That the gates' `exp`, which is the platform's, may differ in its last
    /// bit is not in it.
    pub fn content_hash(&self) -> [u8; 32] {
        *self.hash.as_bytes()
    }

    /// Embeds images, `(n, 3, height, width)`, or sequences, `(n, 3, frames, height, width)`, f32 in
    /// 0..=1, display-referred RGB, to `(n, width)`. The network's own input normalisation is applied.
    /// Sequences may be of any number of frames.
    ///
    /// The embedding of an image is the same to the last bit whatever else is in the batch and
    /// however many threads there are.
    ///
    /// # Errors
    /// When the tensor is of another shape or type, smaller than [`EncoderKind::min_size`], or
    /// computed from a variable: there is no gradient for images.
    pub fn embed(&self, images: &Tensor) -> Result<Tensor> {
        let size = check(&self.network, images)?;
        let values: Vec<f32> = images.flatten_all()?.to_vec1()?;
        let each = Images::each(&values, size);
        let planes = Images::new(&each, Order::Planes, size, self.network.normalisation)?;
        let shape = (each.len(), self.width());
        let embeddings = self.kernels.embed(&planes)?;
        Ok(Tensor::from_vec(embeddings, shape, &Device::Cpu)?)
    }

    /// Embeds images as they lie in most decoders' memory, each `(height, width, 3)` row-major, f32
    /// in 0..=1, display-referred RGB, to `(images, width)`, row-major; as [`Encoder::embed`] does,
    /// but without copies. A sequence is its frames one below the other.
    ///
    /// # Errors
    /// When there is no image, one does not fill its size, or a side is below
    /// [`EncoderKind::min_size`]; sequences of different lengths.
    pub fn embed_pixels(&self, images: &[&[f32]], size: [usize; 2]) -> Result<Vec<f32>> {
        let extents = check_pixels(&self.network, images, size)?;
        Ok(self.kernels.embed(&self.of_pixels(images, extents)?)?)
    }

    /// Images `(..size, 3)` for the kernels.
    fn of_pixels<'a>(&self, pixels: &'a [&'a [f32]], size: Size) -> Result<Images<'a>> {
        let normalisation = self.network.normalisation;
        Ok(Images::new(pixels, Order::Pixels, size, normalisation)?)
    }
}

fn kernels(
    kind: EncoderKind,
    network: &Network,
    weights: &Weights,
    precision: Precision,
) -> Result<Inference> {
    let scales = match precision {
        Precision::Int8 => {
            let found = format_args!("{precision} without scales of the feature maps");
            let expected = "`Encoder::calibrated` before, or the weights of such an encoder";
            let missing = || Error::input("precision", found, expected);
            Some(scales::read(&kind.network(), weights)?.ok_or_else(missing)?)
        }
        _ => None,
    };
    let (scales, level) = (scales.as_deref(), Level::detect());
    Ok(Inference::new(network, weights, precision, scales, level)?)
}

fn content_hash(
    network: &Network,
    depths: &Depths,
    weights: &Weights,
    precision: Precision,
) -> Result<blake3::Hash> {
    let mut hasher = blake3::Hasher::new_derive_key("sps-models encoder");
    hasher.update(network.name.as_bytes());
    // Caches were filled before there were other depths than the last: its hash is what it was.
    if *depths != Depths::Last {
        hasher.update(depths.to_string().as_bytes());
    }
    if precision != Precision::F32 {
        hasher.update(precision.name().as_bytes());
    }
    let rounding = Level::detect().rounding(precision);
    hasher.update(rounding.unwrap_or_default().as_bytes());
    // The scales of int8 count for nothing else.
    let counts = |name: &str| name != scales::TENSOR || precision == Precision::Int8;
    for (name, tensor) in weights.iter().filter(|(name, _)| counts(name)) {
        hasher.update(&(name.len() as u64).to_le_bytes());
        hasher.update(name.as_bytes());
        with_values(tensor, |values: &[f32]| {
            let bytes: Vec<[u8; 4]> = values.iter().map(|value| value.to_le_bytes()).collect();
            hasher.update(bytes.as_flattened());
            Ok(())
        })?;
    }
    Ok(hasher.finalize())
}
