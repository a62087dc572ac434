//! Embeddings of sequences of frames.

use std::path::Path;
use std::sync::Arc;

use candle_core::{DType, Device, Tensor};

use super::batch::{Images, Kernels, each};
use super::images::{Normalisation, Order};
use super::network::Network;
use super::{Embed, Precision, constant, content_hash, fit, init, kernels_of, networks};
use crate::error::{Error, Result};
use crate::weights::{TensorSpec, Weights};

/// The length of an embedding.
const WIDTH: usize = 1024;

/// Inflated Inception-v1, I3D (Carreira and Zisserman, "Quo Vadis, Action Recognition?", CVPR 2017),
/// with its weights: an embedding of a sequence of frames, which need not be a film; views of
/// a surface in the order of their angles are one.
///
/// It runs on this crate's kernels, on the CPU, and is not trained here.
///
/// ```
/// use candle_core::{DType, Device, Tensor};
/// use sps_models::encoders::I3d;
///
/// let encoder = I3d::seeded(0)?;
/// let views = Tensor::zeros((1, 3, 4, 40, 32), DType::F32, &Device::Cpu)?;
/// assert_eq!(encoder.embed(&views)?.dims(), [1, I3d::WIDTH]);
/// # Ok::<(), sps_models::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct I3d {
    network: Arc<Network>,
    kernels: Arc<dyn Kernels>,
    hash: blake3::Hash,
}

impl I3d {
    /// The network's name.
    pub const NAME: &'static str = "i3d";
    /// The length of an embedding.
    pub const WIDTH: usize = WIDTH;

    /// The tensors of the network, in the order of its layers.
    pub fn specs() -> Vec<TensorSpec> {
        networks::i3d(Self::NAME).specs()
    }

    /// Reads the network's weights from a file; see [`Weights::read`] for the formats.
    ///
    /// # Errors
    ///
    /// When the file cannot be read or does not fit: a missing, extra or misshapen tensor, a
    /// value that is not finite. The classifier, `logits`, may be in the file and is not used.
    pub fn load(weights: impl AsRef<Path>) -> Result<Self> {
        Self::new(Weights::read(weights)?)
    }

    /// A network with untrained weights, the same for the same seed everywhere.
    ///
    /// # Errors
    ///
    /// None that a seed could cause.
    pub fn seeded(seed: u64) -> Result<Self> {
        Self::new(init::seeded(&Self::specs(), seed)?)
    }

    /// A network with the given weights.
    ///
    /// # Errors
    ///
    /// When the weights do not fit the network.
    pub fn new(weights: Weights) -> Result<Self> {
        let network = networks::i3d(Self::NAME);
        let weights = fit(&network, weights)?;
        Ok(Self {
            kernels: kernels_of::<f32>(&network, &weights, None)?,
            hash: content_hash(Self::NAME, &weights, &Device::Cpu, Precision::F32)?,
            network: Arc::new(network),
        })
    }

    /// A hash for cache keys; see [`Encoder::content_hash`](super::Encoder::content_hash).
    pub fn content_hash(&self) -> [u8; 32] {
        *self.hash.as_bytes()
    }

    /// Embeds sequences `(batch, 3, frames, height, width)`, f32 in 0..=1, display-referred RGB,
    /// to `(batch, 1024)`: the mean over time and space of the last feature map. Any number of
    /// frames and any size.
    ///
    /// # Errors
    ///
    /// When the tensor is of another shape or type, not on the CPU, or computed from a variable.
    pub fn embed(&self, sequences: &Tensor) -> Result<Tensor> {
        self.run(sequences, &self.network.normalisation)
    }

    /// Embeds sequences that are normalised already, as the network's layers take them.
    ///
    /// # Errors
    ///
    /// As [`I3d::embed`].
    pub fn embed_normalised(&self, sequences: &Tensor) -> Result<Tensor> {
        self.run(sequences, &Normalisation::NONE)
    }

    fn run(&self, sequences: &Tensor, normalisation: &Normalisation) -> Result<Tensor> {
        let (n, size) = match *sequences.dims() {
            [n, 3, frames, height, width]
                if sequences.elem_count() > 0
                    && sequences.dtype() == DType::F32
                    && sequences.device().is_cpu() =>
            {
                (n, [frames, height, width])
            }
            _ => {
                return Err(Error::input(
                    "sequences",
                    format_args!("{:?} of {:?}", sequences.dims(), sequences.dtype()),
                    "(batch, 3, frames, height, width) of F32 on the CPU, none of them 0",
                ));
            }
        };
        constant(sequences)?;
        let values: Vec<f32> = sequences.flatten_all()?.to_vec1()?;
        let embeddings = self.kernels.embed(Images {
            pixels: &each(&values, size),
            order: Order::Planes,
            size,
            normalisation,
        });
        Ok(Tensor::from_vec(embeddings, (n, WIDTH), &Device::Cpu)?)
    }
}

impl Embed for I3d {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn width(&self) -> usize {
        WIDTH
    }

    fn content_hash(&self) -> [u8; 32] {
        self.content_hash()
    }

    fn embed(&self, sequences: &Tensor) -> Result<Tensor> {
        self.embed(sequences)
    }
}
