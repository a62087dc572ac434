//! Inflated Inception-v1, I3D (Carreira and Zisserman, "Quo Vadis, Action Recognition?", CVPR
//! 2017), with the tensor names of the widely used port to PyTorch (`pytorch-i3d`).

mod network;

use std::path::Path;
use std::sync::Arc;

use candle_core::{DType, Device, Tensor};

use super::batch::{Images, Kernels, Pooled, each};
use super::images::{Normalisation, Order};
use super::{Embed, Precision, constant, content_hash, init};
use crate::error::{Error, Result};
use crate::ops::simd::Level;
use crate::weights::{TensorSpec, Weights};
use network::Network;

/// The length of an embedding.
const WIDTH: usize = 1024;
/// What batch norm adds to a variance.
const EPS: f64 = 1e-3;
/// The network takes values in -1..=1.
const NORMALISATION: Normalisation = Normalisation {
    mean: [0.5; 3],
    std: [0.5; 3],
};

/// A layer, or layers side by side, as the authors number them: everything is padded so that its
/// stride alone decides the extents.
#[derive(Debug, Clone, Copy)]
enum Endpoint {
    /// Convolution, batch norm and rectifier: name, channels in and out, window, stride.
    Unit(&'static str, usize, usize, usize, usize),
    /// Max pooling: window and stride.
    Pool([usize; 3], [usize; 3]),
    /// Four branches side by side: name, channels in, channels of the six units.
    Mixed(&'static str, usize, [usize; 6]),
}

const ENDPOINTS: [Endpoint; 16] = [
    Endpoint::Unit("Conv3d_1a_7x7", 3, 64, 7, 2),
    Endpoint::Pool([1, 3, 3], [1, 2, 2]),
    Endpoint::Unit("Conv3d_2b_1x1", 64, 64, 1, 1),
    Endpoint::Unit("Conv3d_2c_3x3", 64, 192, 3, 1),
    Endpoint::Pool([1, 3, 3], [1, 2, 2]),
    Endpoint::Mixed("Mixed_3b", 192, [64, 96, 128, 16, 32, 32]),
    Endpoint::Mixed("Mixed_3c", 256, [128, 128, 192, 32, 96, 64]),
    Endpoint::Pool([3; 3], [2; 3]),
    Endpoint::Mixed("Mixed_4b", 480, [192, 96, 208, 16, 48, 64]),
    Endpoint::Mixed("Mixed_4c", 512, [160, 112, 224, 24, 64, 64]),
    Endpoint::Mixed("Mixed_4d", 512, [128, 128, 256, 24, 64, 64]),
    Endpoint::Mixed("Mixed_4e", 512, [112, 144, 288, 32, 64, 64]),
    Endpoint::Mixed("Mixed_4f", 528, [256, 160, 320, 32, 128, 128]),
    Endpoint::Pool([2; 3], [2; 3]),
    Endpoint::Mixed("Mixed_5b", 832, [256, 160, 320, 32, 128, 128]),
    Endpoint::Mixed("Mixed_5c", 832, [384, 192, 384, 48, 128, 128]),
];

/// A unit within a mixed endpoint: its name, and channels in and out, and its window.
type Branch = (&'static str, usize, usize, usize);

/// The six units of a mixed endpoint.
const fn branches(input: usize, outs: [usize; 6]) -> [Branch; 6] {
    [
        ("b0", input, outs[0], 1),
        ("b1a", input, outs[1], 1),
        ("b1b", outs[1], outs[2], 3),
        ("b2a", input, outs[3], 1),
        ("b2b", outs[3], outs[4], 3),
        ("b3b", input, outs[5], 1),
    ]
}

/// I3D with its weights: an embedding of a sequence of frames, which need not be a film; views of
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
    network: Arc<Pooled<Network>>,
    hash: blake3::Hash,
}

impl I3d {
    /// The network's name.
    pub const NAME: &'static str = "i3d";
    /// The length of an embedding.
    pub const WIDTH: usize = WIDTH;

    /// The tensors of the network, in the order of its layers.
    pub fn specs() -> Vec<TensorSpec> {
        let mut specs = Vec::new();
        for endpoint in ENDPOINTS {
            match endpoint {
                Endpoint::Unit(name, input, out, window, _) => {
                    unit_specs(&mut specs, name, input, out, window);
                }
                Endpoint::Pool(..) => {}
                Endpoint::Mixed(name, input, outs) => {
                    for (branch, input, out, window) in branches(input, outs) {
                        let name = format!("{name}.{branch}");
                        unit_specs(&mut specs, &name, input, out, window);
                    }
                }
            }
        }
        specs
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
        let passes =
            |name: &str| name.starts_with("logits.") || name.ends_with(".num_batches_tracked");
        let weights = weights.fit(Self::NAME, &Self::specs(), passes)?;
        let network = Network::new(&weights, Level::detect())?;
        Ok(Self {
            network: Arc::new(Pooled::new(network)),
            hash: content_hash(Self::NAME, &weights, &Device::Cpu, Precision::F32)?,
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
        self.run(sequences, &NORMALISATION)
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
        let embeddings = self.network.embed(Images {
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

fn unit_specs(specs: &mut Vec<TensorSpec>, name: &str, input: usize, out: usize, window: usize) {
    let shape = [out, input, window, window, window];
    specs.push(TensorSpec::new(format!("{name}.conv3d.weight"), &shape));
    for leaf in ["weight", "bias", "running_mean", "running_var"] {
        specs.push(TensorSpec::new(format!("{name}.bn.{leaf}"), &[out]));
    }
}
