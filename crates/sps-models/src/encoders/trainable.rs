//! Encoders whose weights are variables.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

use candle_core::backprop::GradStore;
use candle_core::{DType, Device, Tensor, Var};
use sps_kernels::network::Network;
use sps_kernels::training::{BatchStatistics, Gradients, Training};
use sps_kernels::{Images, Order, Size};

use super::input::check;
use super::{Block, Depths, Encoder, EncoderKind, Precision, scales};
use crate::differentiable::{differentiable, with_values};
use crate::error::{Error, Result};
use crate::weights::Weights;

/// How much a batch's statistics count in the running ones, as PyTorch's default.
const MOMENTUM: f64 = 0.1;

/// A network whose weights can be trained.
///
/// It runs on this crate's kernels with a backward pass of its own, which
/// [`TrainableEncoder::backward`] joins to candle's; `Tensor::backward` alone, which would leave the
/// weights out, fails.
///
/// ```
/// use candle_core::{DType, Device, Tensor};
/// use sps_models::encoders::{Encoder, EncoderKind, TrainableEncoder};
///
/// let start = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?;
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
    depths: Depths,
    pub(super) network: Arc<Network>,
    /// All tensors by name: those of the variables share their memory.
    pub(super) weights: Weights,
    variables: BTreeMap<String, Var>,
    #[cfg(test)]
    pub(super) plain: bool,
    pub(super) training: Training,
    /// What candle's backward pass ends in, in front of the kernels' own.
    anchor: Var,
    received: Arc<Received>,
}

/// The weights' gradients of backward passes that are under way, each on one thread. A thread that waits
/// for others within a pass may run another pass meanwhile, which is over before the first goes on: of a
/// thread, the last one is at work.
#[derive(Debug, Default)]
struct Received(Mutex<Vec<(ThreadId, Gradients)>>);

impl Received {
    fn passes(&self) -> MutexGuard<'_, Vec<(ThreadId, Gradients)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs candle's backward pass; returns what it says, and what the kernels handed over in it.
    fn listen(&self, loss: &Tensor) -> candle_core::Result<(GradStore, Gradients)> {
        let thread = thread::current().id();
        self.passes().push((thread, Gradients::default()));
        let store = loss.backward();
        let mut passes = self.passes();
        let last = passes.iter().rposition(|(of, _)| *of == thread);
        let gradients = last.map(|last| passes.remove(last).1).unwrap_or_default();
        Ok((store?, gradients))
    }

    /// Hands gradients over to the pass on this thread.
    fn add(&self, gradients: Gradients) -> candle_core::Result<()> {
        let thread = thread::current().id();
        match self.passes().iter_mut().rfind(|(of, _)| *of == thread) {
            Some((_, sum)) => sum.add(gradients),
            None => candle_core::bail!(
                "an encoder's weights have gradients by `TrainableEncoder::backward` of that encoder \
                 alone, not by `Tensor::backward`"
            ),
        }
        Ok(())
    }
}

impl TrainableEncoder {
    /// Copies an encoder's weights into variables.
    ///
    /// # Errors
    /// When there is no room for them.
    pub fn new(encoder: &Encoder) -> Result<Self> {
        let mut variables = BTreeMap::new();
        let mut tensors = Vec::new();
        let specs = encoder.network.specs();
        let used: BTreeSet<&str> = specs.iter().map(|spec| &spec.name[..]).collect();
        // The scales of int8 belong to weights that do not change.
        let tensors_of = encoder.weights().iter();
        for (name, tensor) in tensors_of.filter(|(name, _)| *name != scales::TENSOR) {
            let moved = name.ends_with(".running_mean") || name.ends_with(".running_var");
            if moved || !used.contains(name) {
                tensors.push((name.to_owned(), tensor.clone()));
            } else {
                let variable = Var::from_tensor(&tensor.copy()?)?;
                tensors.push((name.to_owned(), variable.as_tensor().clone()));
                variables.insert(name.to_owned(), variable);
            }
        }
        Ok(Self {
            kind: encoder.kind(),
            depths: encoder.depths().clone(),
            network: Arc::clone(&encoder.network),
            weights: Weights::sharing(encoder.weights().origin(), tensors),
            variables,
            #[cfg(test)]
            plain: false,
            training: Training::new(Arc::clone(&encoder.network)),
            anchor: Var::zeros(1, DType::F32, &Device::Cpu)?,
            received: Arc::default(),
        })
    }

    /// Gradient checkpointing: keeps only each block's input for the backward pass, which then
    /// runs each block forward once more. The gradients are the same to the last bit.
    #[must_use]
    pub fn with_checkpointing(mut self, checkpointing: bool) -> Self {
        self.training.checkpointing = checkpointing;
        self
    }

    /// Batch norm by the running statistics, which stay as they are, rather than by the batch's own: an image's
    /// embedding is then what [`TrainableEncoder::encoder`] gives, whatever else is in the batch.
    #[must_use]
    pub fn with_running_statistics(mut self, running: bool) -> Self {
        self.training.running_statistics = running;
        self
    }

    /// What feature maps and their gradients are made of: f32, or bf16, which takes half the memory. Weights,
    /// their gradients, sums and statistics are f32 with both.
    ///
    /// # Errors
    /// When the precision is another.
    pub fn with_precision(mut self, precision: Precision) -> Result<Self> {
        if !matches!(precision, Precision::F32 | Precision::Bf16) {
            let what = "precision of training";
            return Err(Error::input(what, precision, "f32 or bf16"));
        }
        self.training.precision = precision;
        Ok(self)
    }

    /// Which network this is.
    pub fn kind(&self) -> EncoderKind {
        self.kind
    }

    /// Which feature maps an embedding is made of.
    pub fn depths(&self) -> &Depths {
        &self.depths
    }

    /// The blocks of an embedding, in their order.
    pub fn blocks(&self) -> Vec<Block> {
        self.network.named_blocks()
    }

    /// What training changes, in the order of the names: all that embeddings of its depths need but running
    /// statistics.
    pub fn variables(&self) -> impl Iterator<Item = (&str, &Var)> {
        let variables = self.variables.iter();
        variables.map(|(name, variable)| (name.as_str(), variable))
    }

    /// All tensors as they are now, for a checkpoint or an [`Encoder`].
    ///
    /// # Errors
    /// When a weight is no longer finite.
    pub fn weights(&self) -> Result<Weights> {
        let tensors = self.weights.iter();
        let tensors = tensors.map(|(name, tensor)| (name.to_owned(), tensor.clone()));
        Ok(Weights::from_tensors(self.weights.origin(), tensors)?)
    }

    /// The encoder as it is now, for inference.
    ///
    /// # Errors
    /// When a weight is no longer finite.
    pub fn encoder(&self) -> Result<Encoder> {
        Encoder::new(self.kind, self.weights()?)?.with_depths(&self.depths)
    }

    /// Embeds images or sequences, as [`Encoder::embed`] takes them, to `(n, width)`, as training does:
    /// batch norm by the batch's own statistics, which also move the running ones, unless
    /// [`TrainableEncoder::with_running_statistics`] says otherwise.
    ///
    /// # Errors
    /// When the tensor is of another shape or type or computed from a variable (there is no gradient
    /// for images), or a batch norm sees a single number in each channel.
    pub fn forward(&mut self, images: &Tensor) -> Result<Tensor> {
        let size = check(&self.network, images)?;
        #[cfg(test)]
        if self.plain {
            return self.forward_plain(images);
        }
        let (embeddings, statistics) = self.run(images, size)?;
        for statistics in statistics {
            self.update(&statistics)?;
        }
        Ok(embeddings)
    }

    /// The gradients of a loss that was computed from this encoder's embeddings: candle's for
    /// everything else, and those of this encoder's variables.
    ///
    /// Use it in place of `loss.backward()`, which fails. Embeddings of several passes may be in the
    /// loss, all by one encoder.
    ///
    /// # Errors
    /// When candle's backward pass fails, or another encoder's embeddings are in the loss.
    pub fn backward(&self, loss: &Tensor) -> Result<GradStore> {
        let (mut store, Gradients(gradients)) = self.received.listen(loss)?;
        for (name, values) in gradients {
            if let Some(variable) = self.variables.get(&name) {
                let gradient = Tensor::from_vec(values, variable.dims(), &Device::Cpu)?;
                store.insert(variable, gradient);
            }
        }
        Ok(store)
    }

    /// By the kernels.
    fn run(&self, images: &Tensor, size: Size) -> Result<(Tensor, Vec<BatchStatistics>)> {
        let values: Vec<f32> = images.flatten_all()?.to_vec1()?;
        let each = Images::each(&values, size);
        let images = Images::new(&each, Order::Planes, size, self.network.normalisation)?;
        let weights = Arc::new(self.weights.clone());
        let forward = self.training.forward(weights, &images)?;
        let (pass, received) = (forward.pass, Arc::clone(&self.received));
        let backward = move |_: &Tensor, gradient: &Tensor| {
            let gradients = with_values(gradient, |gradient| {
                pass.backward(gradient).map_err(candle_core::Error::wrap)
            });
            received.add(gradients?)?;
            Ok(None)
        };
        let shape = (each.len(), self.network.width());
        let anchor = self.anchor.as_tensor();
        let embeddings = differentiable([anchor; 2], forward.embeddings, shape, backward)?;
        Ok((embeddings, forward.statistics))
    }

    /// Moves a batch norm's running statistics towards a batch's.
    pub(super) fn update(&mut self, batch: &BatchStatistics) -> Result<()> {
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
            let new = Tensor::from_iter(new, &Device::Cpu)?;
            self.weights.replace(&name, new);
        }
        Ok(())
    }
}
