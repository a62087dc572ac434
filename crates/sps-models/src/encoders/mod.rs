//! Networks that turn an image into an embedding.
//!
//! An embedding is the mean over space of the network's last feature map.

mod batch;
mod folded;
mod i3d;
mod images;
mod init;
mod kind;
mod plain;
mod precision;
mod se_resnext;
mod squeezenet;
#[cfg(test)]
mod tests;
mod trainable;

use std::path::Path;
use std::sync::Arc;

use candle_core::{DType, Device, Tensor};

pub use i3d::I3d;
pub use kind::EncoderKind;
pub use precision::Precision;
pub use se_resnext::SeResNextConfig;
pub use trainable::TrainableEncoder;

use crate::error::{Error, Result};
use crate::ops::simd::Level;
use crate::weights::Weights;
use batch::{Images, Pooled, each};
use images::{Normalisation, Order};
use plain::Plain;

/// A network with its weights, ready to embed images.
///
/// ```
/// use candle_core::{DType, Device, Tensor};
/// use sps_models::encoders::{Encoder, EncoderKind};
///
/// let encoder = Encoder::seeded(EncoderKind::SeResNextSmall, 0, &Device::Cpu)?;
/// let images = Tensor::zeros((2, 3, 64, 48), DType::F32, &Device::Cpu)?;
/// assert_eq!(encoder.embed(&images)?.dims(), [2, encoder.width()]);
/// # Ok::<(), sps_models::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Encoder {
    kind: EncoderKind,
    precision: Precision,
    weights: Weights,
    device: Device,
    hash: blake3::Hash,
    engine: Engine,
}

/// What carries out the network.
#[derive(Debug, Clone)]
enum Engine {
    /// Candle's own operators, on any device.
    Plain,
    /// The kernels of this crate, on the CPU.
    SeResNext(Arc<Pooled<se_resnext::fused::Fused>>),
    /// The kernels of this crate, on the CPU.
    SqueezeNet(Arc<Pooled<squeezenet::fused::Fused>>),
}

impl Encoder {
    /// Reads the network's weights from a file; see [`Weights::read`] for the formats.
    ///
    /// # Errors
    ///
    /// When the file cannot be read or does not fit: a missing, extra or misshapen tensor, a
    /// value that is not finite. A classifier's last layer may be in the file and is not used.
    pub fn load(kind: EncoderKind, weights: impl AsRef<Path>, device: &Device) -> Result<Self> {
        Self::new(kind, Weights::read(weights)?, device)
    }

    /// A network with untrained weights, the same for the same seed everywhere.
    ///
    /// # Errors
    ///
    /// When the device has no room for the weights.
    pub fn seeded(kind: EncoderKind, seed: u64, device: &Device) -> Result<Self> {
        Self::new(kind, init::seeded(&kind.specs(), seed)?, device)
    }

    /// A network with the given weights.
    ///
    /// # Errors
    ///
    /// When the weights do not fit the network.
    pub fn new(kind: EncoderKind, weights: Weights, device: &Device) -> Result<Self> {
        let weights = weights.fit(kind.name(), &kind.specs(), |name| kind.passes(name))?;
        let precision = Precision::default();
        Ok(Self {
            kind,
            precision,
            engine: Engine::new(kind, &weights, device, precision)?,
            hash: content_hash(kind.name(), &weights, precision)?,
            weights: weights.to_device(device)?,
            device: device.clone(),
        })
    }

    /// The same network, computing in another precision.
    ///
    /// # Errors
    ///
    /// When the device is not the CPU and the precision not f32.
    pub fn with_precision(self, precision: Precision) -> Result<Self> {
        if !self.device.is_cpu() && precision != Precision::F32 {
            return Err(Error::input(
                "precision",
                format_args!("{precision} on another device than the CPU"),
                format_args!("{}", Precision::F32),
            ));
        }
        Ok(Self {
            precision,
            engine: Engine::new(self.kind, &self.weights, &self.device, precision)?,
            hash: content_hash(self.kind.name(), &self.weights, precision)?,
            ..self
        })
    }

    /// Which network this is.
    pub fn kind(&self) -> EncoderKind {
        self.kind
    }

    /// What the network computes in.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// The length of an embedding.
    pub fn width(&self) -> usize {
        self.kind.width()
    }

    /// The network's weights.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The device that images must be on.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// A hash of the network's name, its precision and every weight, for cache keys: two encoders
    /// with one hash give the same embeddings.
    pub fn content_hash(&self) -> [u8; 32] {
        *self.hash.as_bytes()
    }

    /// Embeds images, `(n, 3, height, width)`, f32 in 0..=1, display-referred RGB, to
    /// `(n, width)`. The network's own input normalisation is applied.
    ///
    /// The embedding of an image is the same to the last bit whatever else is in the batch and
    /// however many threads there are.
    ///
    /// # Errors
    ///
    /// When the tensor is of another shape or type, or smaller than
    /// [`EncoderKind::min_size`].
    pub fn embed(&self, images: &Tensor) -> Result<Tensor> {
        check(self.kind, images)?;
        self.run(images, &Normalisation::IMAGENET)
    }

    /// Embeds images as they lie in most decoders' memory, each `(height, width, 3)` row-major, f32
    /// in 0..=1, display-referred RGB, to `(images, width)`, row-major; as [`Encoder::embed`] does,
    /// but without copies.
    ///
    /// # Errors
    ///
    /// When there is no image, one does not fill its size, or a side is below
    /// [`EncoderKind::min_size`].
    pub fn embed_pixels(&self, images: &[&[f32]], size: [usize; 2]) -> Result<Vec<f32>> {
        let [height, width] = size;
        let min = self.kind.min_size();
        let len = height.checked_mul(width).and_then(|n| n.checked_mul(3));
        let misfit = images.iter().find(|image| Some(image.len()) != len);
        if images.is_empty() || misfit.is_some() || height.min(width) < min {
            let values = misfit.or(images.first()).map_or(0, |image| image.len());
            return Err(Error::input(
                "pixels",
                format_args!(
                    "{} images, one of {values} values for {size:?}",
                    images.len()
                ),
                format_args!("images of three values a pixel, sides of at least {min}"),
            ));
        }
        if let Engine::Plain = self.engine {
            let shape = (images.len(), height, width, 3);
            let images = Tensor::from_vec(images.concat(), shape, &self.device)?;
            let embeddings = self.embed(&images.permute((0, 3, 1, 2))?)?;
            return Ok(embeddings.flatten_all()?.to_vec1()?);
        }
        Ok(self.engine.embed(Images {
            pixels: images,
            order: Order::Pixels,
            size: [1, height, width],
            normalisation: &Normalisation::IMAGENET,
        }))
    }

    /// Embeds images that are normalised already, as the network's layers take them.
    ///
    /// # Errors
    ///
    /// As [`Encoder::embed`].
    pub fn embed_normalised(&self, images: &Tensor) -> Result<Tensor> {
        check(self.kind, images)?;
        self.run(images, &Normalisation::NONE)
    }

    /// Embeds images as [`Encoder::embed`] does, by candle's own operators: what the kernels are
    /// measured against, and what runs on devices other than the CPU.
    ///
    /// # Errors
    ///
    /// As [`Encoder::embed`].
    pub fn embed_plain(&self, images: &Tensor) -> Result<Tensor> {
        check(self.kind, images)?;
        self.run_plain(images, &Normalisation::IMAGENET)
    }

    fn run(&self, images: &Tensor, normalisation: &Normalisation) -> Result<Tensor> {
        if let Engine::Plain = self.engine {
            return self.run_plain(images, normalisation);
        }
        let (n, _, height, width) = images.dims4()?;
        let values: Vec<f32> = images.flatten_all()?.to_vec1()?;
        let size = [1, height, width];
        let embeddings = self.engine.embed(Images {
            pixels: &each(&values, size),
            order: Order::Planes,
            size,
            normalisation,
        });
        Ok(Tensor::from_vec(
            embeddings,
            (n, self.width()),
            &self.device,
        )?)
    }

    fn run_plain(&self, images: &Tensor, normalisation: &Normalisation) -> Result<Tensor> {
        let images = normalise(images, normalisation)?;
        let net = Plain::new(&self.weights);
        match self.kind.se_resnext() {
            Some(config) => se_resnext::plain::embed(&config, &net, &images),
            None => squeezenet::plain::embed(&net, &images),
        }
    }
}

fn check(kind: EncoderKind, images: &Tensor) -> Result<()> {
    let min = kind.min_size();
    let fits = matches!(*images.dims(), [n, 3, h, w] if n > 0 && h >= min && w >= min);
    if fits && images.dtype() == DType::F32 {
        return Ok(());
    }
    Err(Error::input(
        "images",
        format_args!("{:?} of {:?}", images.dims(), images.dtype()),
        format_args!("(n, 3, height, width) of F32, n > 0, sides of at least {min}"),
    ))
}

fn normalise(images: &Tensor, normalisation: &Normalisation) -> Result<Tensor> {
    let device = images.device();
    let row = |values: &[f32; 3]| Tensor::new(values, device)?.reshape((1, 3, 1, 1));
    let centred = images.broadcast_sub(&row(&normalisation.mean)?)?;
    Ok(centred.broadcast_div(&row(&normalisation.std)?)?)
}

impl Engine {
    /// Embeds by the kernels; nothing where there are none.
    fn embed(&self, images: Images<'_>) -> Vec<f32> {
        match self {
            Self::Plain => Vec::new(),
            Self::SeResNext(network) => network.embed(images),
            Self::SqueezeNet(network) => network.embed(images),
        }
    }

    fn new(
        kind: EncoderKind,
        weights: &Weights,
        device: &Device,
        precision: Precision,
    ) -> Result<Self> {
        if !device.is_cpu() {
            return Ok(Self::Plain);
        }
        let (level, format) = (Level::detect(), precision.format());
        Ok(if let Some(config) = kind.se_resnext() {
            let network = se_resnext::fused::Fused::new(&config, weights, level, format)?;
            Self::SeResNext(Arc::new(Pooled::new(network)))
        } else {
            let network = squeezenet::fused::Fused::new(weights, level, format)?;
            Self::SqueezeNet(Arc::new(Pooled::new(network)))
        })
    }
}

fn content_hash(network: &str, weights: &Weights, precision: Precision) -> Result<blake3::Hash> {
    let mut hasher = blake3::Hasher::new_derive_key("sps-models encoder");
    hasher.update(network.as_bytes());
    if precision != Precision::F32 {
        hasher.update(precision.name().as_bytes());
    }
    for (name, tensor) in weights.iter() {
        hasher.update(&(name.len() as u64).to_le_bytes());
        hasher.update(name.as_bytes());
        let values: Vec<f32> = tensor.flatten_all()?.to_vec1()?;
        let bytes: Vec<u8> = values.into_iter().flat_map(f32::to_le_bytes).collect();
        hasher.update(&bytes);
    }
    Ok(hasher.finalize())
}
