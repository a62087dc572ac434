//! Encoders whose weights are variables.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use candle_core::backprop::GradStore;
use candle_core::{CpuStorage, CustomOp1, DType, Device, Layout, Shape, Tensor, Var};

use super::batch::{Images, each};
use super::images::{Normalisation, Order};
use super::plain::{BatchStatistics, Plain};
use super::se_resnext::train::{Context, Gradients, Tape};
use super::{Encoder, EncoderKind, SeResNextConfig, check, normalise, se_resnext, squeezenet};
use crate::error::{Error, Result};
use crate::ops::bands::inside_pool;
use crate::ops::buffer::Recycler;
use crate::ops::simd::Level;
use crate::ops::with_values;
use crate::weights::Weights;

/// How much a batch's statistics count in the running ones, as PyTorch's default.
const MOMENTUM: f64 = 0.1;

/// A network whose weights can be trained.
///
/// On the CPU, a squeeze-and-excitation ResNeXt runs on this crate's kernels with a backward pass
/// of its own, which [`TrainableEncoder::backward`] joins to candle's.
///
/// ```
/// use candle_core::{DType, Device, Tensor};
/// use sps_models::encoders::{Encoder, EncoderKind, TrainableEncoder};
///
/// let start = Encoder::seeded(EncoderKind::SeResNextSmall, 0, &Device::Cpu)?;
/// let mut encoder = TrainableEncoder::new(&start)?;
/// let images = Tensor::zeros((2, 3, 32, 32), DType::F32, &Device::Cpu)?;
///
/// let loss = encoder.forward(&images)?.sqr()?.mean_all()?;
/// let gradients = encoder.backward(&loss)?;
/// for (name, variable) in encoder.variables() {
///     assert!(gradients.get(variable).is_some(), "{name}");
/// }
/// # Ok::<(), sps_models::Error>(())
/// ```
#[derive(Debug)]
pub struct TrainableEncoder {
    kind: EncoderKind,
    /// All tensors by name: those of the variables share their memory.
    weights: Weights,
    variables: BTreeMap<String, Var>,
    device: Device,
    plain: bool,
    checkpointing: bool,
    /// What candle's backward pass ends in, in front of the kernels' own.
    anchor: Var,
    recycler: Arc<Recycler>,
    gradients: Arc<Mutex<Gradients>>,
}

impl TrainableEncoder {
    /// Copies an encoder's weights into variables.
    ///
    /// # Errors
    ///
    /// When the device has no room for them.
    pub fn new(encoder: &Encoder) -> Result<Self> {
        let device = encoder.device().clone();
        let mut variables = BTreeMap::new();
        let mut tensors = Vec::new();
        for (name, tensor) in encoder.weights().iter() {
            if name.ends_with(".running_mean") || name.ends_with(".running_var") {
                tensors.push((name.to_owned(), tensor.clone()));
            } else {
                let variable = Var::from_tensor(&tensor.copy()?)?;
                tensors.push((name.to_owned(), variable.as_tensor().clone()));
                variables.insert(name.to_owned(), variable);
            }
        }
        Ok(Self {
            kind: encoder.kind(),
            weights: Weights::sharing(encoder.weights().origin(), tensors),
            variables,
            plain: !device.is_cpu(),
            checkpointing: false,
            anchor: Var::zeros(1, DType::F32, &device)?,
            device,
            recycler: Arc::default(),
            gradients: Arc::default(),
        })
    }

    /// Trains by candle's own operators even where the kernels could: what they are measured
    /// against.
    #[must_use]
    pub fn with_plain_operators(mut self) -> Self {
        self.plain = true;
        self
    }

    /// Gradient checkpointing: keeps only each block's input for the backward pass, which then
    /// runs each block forward once more. The gradients are the same to the last bit.
    #[must_use]
    pub fn with_checkpointing(mut self, checkpointing: bool) -> Self {
        self.checkpointing = checkpointing;
        self
    }

    /// Which network this is.
    pub fn kind(&self) -> EncoderKind {
        self.kind
    }

    /// What training changes, in the order of the names: everything but running statistics.
    pub fn variables(&self) -> impl Iterator<Item = (&str, &Var)> {
        self.variables
            .iter()
            .map(|(name, variable)| (name.as_str(), variable))
    }

    /// All tensors as they are now, for a checkpoint or an [`Encoder`].
    ///
    /// # Errors
    ///
    /// When a weight is no longer finite.
    pub fn weights(&self) -> Result<Weights> {
        let tensors = self.weights.iter();
        let tensors = tensors.map(|(name, tensor)| (name.to_owned(), tensor.clone()));
        Ok(Weights::from_tensors(self.weights.origin(), tensors)?)
    }

    /// The encoder as it is now, for inference.
    ///
    /// # Errors
    ///
    /// When a weight is no longer finite.
    pub fn encoder(&self) -> Result<Encoder> {
        Encoder::new(self.kind, self.weights()?, &self.device)
    }

    /// Embeds images, `(n, 3, height, width)`, f32 in 0..=1, display-referred RGB, to
    /// `(n, width)`, as training does: batch norm by the batch's own statistics, which also move
    /// the running ones.
    ///
    /// # Errors
    ///
    /// When the tensor is of another shape or type, or a batch norm sees a single number in each
    /// channel.
    pub fn forward(&mut self, images: &Tensor) -> Result<Tensor> {
        self.run(images, &Normalisation::IMAGENET)
    }

    /// As [`TrainableEncoder::forward`], with images that are normalised already.
    ///
    /// # Errors
    ///
    /// As [`TrainableEncoder::forward`].
    pub fn forward_normalised(&mut self, images: &Tensor) -> Result<Tensor> {
        self.run(images, &Normalisation::NONE)
    }

    /// The gradients of a loss that was computed from this encoder's embeddings: candle's for
    /// everything else, and those of this encoder's variables.
    ///
    /// Use it in place of `loss.backward()`, which does not know of them.
    ///
    /// # Errors
    ///
    /// When candle's backward pass fails.
    pub fn backward(&self, loss: &Tensor) -> Result<GradStore> {
        std::mem::take(&mut *self.noted());
        let mut store = loss.backward()?;
        let Gradients(gradients) = std::mem::take(&mut *self.noted());
        for (name, values) in gradients {
            if let Some(variable) = self.variables.get(&name) {
                let gradient = Tensor::from_vec(values, variable.dims(), &self.device)?;
                store.insert(variable, gradient);
            }
        }
        Ok(store)
    }

    fn noted(&self) -> std::sync::MutexGuard<'_, Gradients> {
        self.gradients
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn run(&mut self, images: &Tensor, normalisation: &Normalisation) -> Result<Tensor> {
        check(self.kind, images)?;
        let (embeddings, statistics) = match self.kind.se_resnext() {
            Some(config) if !self.plain => self.run_fused(config, images, normalisation)?,
            config => self.run_plain(config, images, normalisation)?,
        };
        for statistics in statistics {
            self.update(&statistics)?;
        }
        Ok(embeddings)
    }

    fn run_plain(
        &self,
        config: Option<SeResNextConfig>,
        images: &Tensor,
        normalisation: &Normalisation,
    ) -> Result<(Tensor, Vec<BatchStatistics>)> {
        let net = Plain::training(&self.weights);
        let images = normalise(images, normalisation)?;
        let embeddings = match config {
            Some(config) => se_resnext::plain::embed(&config, &net, &images)?,
            None => squeezenet::plain::embed(&net, &images)?,
        };
        Ok((embeddings, net.into_statistics()))
    }

    fn run_fused(
        &self,
        config: SeResNextConfig,
        images: &Tensor,
        normalisation: &Normalisation,
    ) -> Result<(Tensor, Vec<BatchStatistics>)> {
        let (_, _, height, width) = images.dims4()?;
        let values: Vec<f32> = images.flatten_all()?.to_vec1()?;
        let size = [1, height, width];
        let images = Images {
            pixels: &each(&values, size),
            order: Order::Planes,
            size,
            normalisation,
        };
        let bridge = Bridge {
            weights: self.weights.clone(),
            recycler: Arc::clone(&self.recycler),
            gradients: Arc::clone(&self.gradients),
            tape: None,
            embeddings: Vec::new(),
            frames: images.frames(),
        };
        let mut statistics = Vec::new();
        let context = bridge.context();
        let (tape, embeddings) = inside_pool(|| {
            let tape = Tape::record(
                &config,
                &context,
                &images,
                self.checkpointing,
                &mut statistics,
            )?;
            let embeddings = tape.embeddings(&context);
            Ok::<_, Error>((tape, embeddings))
        })?;
        let bridge = Bridge {
            tape: Some(tape),
            embeddings,
            ..bridge
        };
        Ok((self.anchor.apply_op1(bridge)?, statistics))
    }

    /// Moves a batch norm's running statistics towards a batch's.
    fn update(&mut self, batch: &BatchStatistics) -> Result<()> {
        let unbiased = batch.count as f64 / (batch.count - 1) as f64;
        for (leaf, values, factor) in [
            ("running_mean", &batch.mean, 1.0),
            ("running_var", &batch.variance, unbiased),
        ] {
            let name = format!("{}.{leaf}", batch.layer);
            let old: Vec<f32> = self.weights.get(&name)?.to_vec1()?;
            let new = old.iter().zip(values).map(|(&old, &new)| {
                ((1.0 - MOMENTUM) * f64::from(old) + MOMENTUM * f64::from(new) * factor) as f32
            });
            let new = Tensor::from_iter(new, &self.device)?;
            self.weights.replace(&name, new);
        }
        Ok(())
    }
}

/// A forward pass of the kernels as candle sees it: an operator whose output is the embeddings.
///
/// Its backward pass leaves the parameters' gradients where the encoder finds them.
struct Bridge {
    weights: Weights,
    recycler: Arc<Recycler>,
    gradients: Arc<Mutex<Gradients>>,
    tape: Option<Tape>,
    embeddings: Vec<f32>,
    frames: usize,
}

impl Bridge {
    fn context(&self) -> Context<'_> {
        Context {
            weights: &self.weights,
            recycler: &self.recycler,
            level: Level::detect(),
        }
    }
}

impl CustomOp1 for Bridge {
    fn name(&self) -> &'static str {
        "encoder"
    }

    fn cpu_fwd(&self, _: &CpuStorage, _: &Layout) -> candle_core::Result<(CpuStorage, Shape)> {
        let shape = Shape::from((self.frames, self.embeddings.len() / self.frames));
        Ok((CpuStorage::F32(self.embeddings.clone()), shape))
    }

    fn bwd(
        &self,
        _: &Tensor,
        _: &Tensor,
        cotangent: &Tensor,
    ) -> candle_core::Result<Option<Tensor>> {
        let Some(tape) = &self.tape else {
            return Ok(None);
        };
        let gradients = with_values(cotangent, |cotangent| {
            let gradients = inside_pool(|| tape.backward(&self.context(), cotangent));
            gradients.map_err(candle_core::Error::wrap)
        })?;
        let mut all = self
            .gradients
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        all.add(gradients);
        Ok(None)
    }
}
