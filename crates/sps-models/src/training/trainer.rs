use candle_core::Tensor;
use serde::{Deserialize, Serialize};

use super::batches::{self, Batch, ImageSource, Vary};
use super::config::TrainingConfig;
use super::kept::Kept;
use super::objective::{Losses, Objective};
use super::state;
use super::targets::Targets;
use crate::encoders::{Encoder, TrainableEncoder};
use crate::error::{Result, require};
use crate::heads::Share;
use crate::optim::{Adam, clip_scales, squared_norms};
use crate::weights::Weights;

/// Which images, or surfaces of several views, are trained on, and which say how good the network is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parts {
    /// Trained on.
    pub training: Vec<usize>,
    /// Never trained on; may be empty.
    pub validation: Vec<usize>,
}

/// Trains an encoder to say values or classes of its images, an epoch at a time.
///
/// Everything that happens is a function of the encoder, the images, the config and the seed, to
/// the last bit: also where training is stopped after any epoch and goes on from
/// [`Trainer::to_bytes`], and for any number of threads.
#[derive(Debug)]
pub struct Trainer {
    pub(super) config: TrainingConfig,
    pub(super) seed: u64,
    pub(super) encoder: TrainableEncoder,
    pub(super) objective: Objective,
    kept: Option<Kept>,
    pub(super) adam: Adam,
    parts: Parts,
    /// Images of a surface.
    views: usize,
    /// A hash of targets and parts.
    pub(super) data: String,
    pub(super) history: Vec<Epoch>,
    pub(super) best: Option<Best>,
}

/// The best network so far.
#[derive(Debug)]
pub(super) struct Best {
    pub(super) epoch: usize,
    pub(super) loss: f64,
    pub(super) weights: Weights,
}

/// What an epoch did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Epoch {
    /// Counted from 1.
    pub number: usize,
    /// Steps since training began.
    pub steps: usize,
    /// Of the last step.
    pub learning_rate: f64,
    /// Mean over the epoch's images, each as the network was when it saw them.
    pub training: Losses,
    /// Of the validation images, not varied, after the epoch.
    pub validation: Option<Losses>,
    /// Whether it is the best so far.
    pub best: bool,
}

/// A step that was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingStep {
    /// Counted from 1, since training began.
    pub number: usize,
    /// Steps of the whole training, should it not end early.
    pub of: usize,
    /// Images of the step.
    pub images: usize,
    /// Its learning rate.
    pub learning_rate: f64,
    /// Norm of the gradient of all parameters together, before clipping.
    pub gradient_norm: f64,
    /// What the loss was.
    pub losses: Losses,
}

impl Trainer {
    /// Begins to train a copy of `encoder` on images with the given targets.
    ///
    /// # Errors
    /// A config that cannot be meant, targets that do not fit the images, an empty training part.
    pub fn new(
        encoder: &Encoder,
        targets: Targets,
        parts: Parts,
        config: TrainingConfig,
        seed: u64,
    ) -> Result<Self> {
        config.check()?;
        check(&targets, &parts)?;
        let views = targets.views();
        let data = state::hash(&targets, &parts)?;
        let encoder = TrainableEncoder::new(encoder)?.with_precision(config.precision)?;
        let encoder = encoder.with_checkpointing(config.checkpointing);
        let encoder = encoder.with_running_statistics(config.running_statistics.unwrap_or(true));
        let blocks = encoder.blocks();
        let width = blocks.iter().map(|block| block.width).sum();
        let kept = targets.kept.clone();
        kept.iter().try_for_each(|kept| kept.check(&blocks))?;
        let objective = Objective::new(&config, targets, &parts.training, width, seed)?;
        // What training changes, in an order that never differs.
        let of_encoder = encoder.variables().map(|(_, variable)| variable.clone());
        let of_objective = objective.parameters().map(|(_, variable)| variable.clone());
        let adam = Adam::new(config.adam.clone(), of_encoder.chain(of_objective))?;
        Ok(Self {
            config,
            seed,
            encoder,
            objective,
            kept,
            adam,
            parts,
            views,
            data,
            history: Vec::new(),
            best: None,
        })
    }

    /// The epochs that were trained.
    pub fn history(&self) -> &[Epoch] {
        &self.history
    }

    /// Whether all epochs were trained, or patience is at its end.
    pub fn is_finished(&self) -> bool {
        let done = self.history.len();
        let patience = self.config.patience;
        let waited = self.best.as_ref().map_or(0, |best| done - best.epoch);
        done >= self.config.epochs || (patience > 0 && waited >= patience)
    }

    /// Trains one epoch; `observe` sees each step.
    ///
    /// # Errors
    /// An image that cannot be had or is of another size than its batch; a loss, of a step or of the
    /// validation images, that is no longer finite.
    pub fn epoch(
        &mut self,
        source: &dyn ImageSource,
        mut observe: impl FnMut(&TrainingStep),
    ) -> Result<&Epoch> {
        let epoch = self.history.len();
        let size = self.config.batch_size;
        let batches = batches::epoch(&self.parts.training, size, self.seed, epoch);
        let augmentation = self.config.augmentation;
        let vary = Vary {
            augmentation: &augmentation,
            seed: self.seed,
            epoch,
            views: self.views,
        };
        let mut number = epoch * batches.len();
        let mut training = Losses::default();
        batches::for_each(source, &batches, &vary, |batch| {
            let step = self.step(&batch, number)?;
            let weight = batch.surfaces.len() as f64 / self.parts.training.len() as f64;
            training.add(&step.losses, weight);
            number = step.number;
            observe(&step);
            Ok(())
        })?;
        let validation = self.validate(source)?;
        let best = self.keep_if_best(validation)?;
        self.history.push(Epoch {
            number: epoch + 1,
            steps: number,
            learning_rate: self.config.learning_rate(number - 1, self.steps()),
            training,
            validation,
            best,
        });
        Ok(&self.history[epoch])
    }

    /// The network: the best on the validation images, or the last where there are none.
    ///
    /// # Errors
    /// When a weight is no longer finite.
    pub fn into_encoder(self) -> Result<Encoder> {
        match self.best {
            Some(best) => {
                let encoder = Encoder::new(self.encoder.kind(), best.weights)?;
                encoder.with_depths(self.encoder.depths())
            }
            None => self.encoder.encoder(),
        }
    }

    /// Steps of the whole training.
    pub(super) fn steps(&self) -> usize {
        let epoch = batches::steps(self.parts.training.len(), self.config.batch_size);
        self.config.epochs.saturating_mul(epoch)
    }

    fn step(&mut self, batch: &Batch, done: usize) -> Result<TrainingStep> {
        let (gradients, losses) = self.gradients(batch, done)?;
        let (gradients, gradient_norm) = self.clipped(gradients)?;
        let learning_rate = self.config.learning_rate(done, self.steps());
        self.adam.set_learning_rate(learning_rate);
        self.adam.step(&gradients, &[])?;
        Ok(TrainingStep {
            number: done + 1,
            of: self.steps(),
            images: batch.tensor.dim(0)?,
            learning_rate,
            gradient_norm,
            losses,
        })
    }

    /// The gradients of a step's loss, in the order of the parameters, and what the losses were: sums over
    /// the parts in which its batch goes through the network.
    pub(super) fn gradients(
        &mut self,
        batch: &Batch,
        done: usize,
    ) -> Result<(Vec<Tensor>, Losses)> {
        let of = &batch.surfaces[..];
        let at_once = self.config.micro_batch_size.unwrap_or(of.len());
        let mut losses = Losses::default();
        let mut sums: Vec<Tensor> = Vec::new();
        for part in batches::cut(of.len(), at_once) {
            let (first, images) = (part.start * self.views, part.len() * self.views);
            let images = batch.tensor.narrow(0, first, images)?;
            let surfaces = &of[part];
            let share = Share { surfaces, of };
            let (gradients, loss) = self.gradients_of_part(&images, share, done)?;
            losses.add(&loss, 1.0);
            check_finite("loss", &losses)?;
            if sums.is_empty() {
                sums = gradients;
                continue;
            }
            for (sum, more) in sums.iter_mut().zip(&gradients) {
                *sum = (&*sum + more)?;
            }
        }
        Ok((sums, losses))
    }

    fn gradients_of_part(
        &mut self,
        images: &Tensor,
        share: Share<'_>,
        done: usize,
    ) -> Result<(Vec<Tensor>, Losses)> {
        let frozen = self.history.len() < self.config.frozen_epochs;
        let mut embeddings = self.encoder.forward(images)?;
        if frozen {
            embeddings = embeddings.detach();
        }
        let (mut loss, mut losses) = self.objective.loss(&embeddings, share, done)?;
        if let Some(kept) = &self.kept
            && let Some(of_kept) = kept.loss(images, &embeddings, share)?
        {
            losses.kept = f64::from(of_kept.to_scalar::<f32>()?);
            loss = (loss + of_kept)?;
        }
        let store = self.encoder.backward(&loss)?;
        let of_encoder = self.encoder.variables().map(|(_, variable)| {
            // Adam does not move what never had a gradient.
            let gradient = store.get(variable).cloned();
            gradient.map_or_else(|| variable.zeros_like(), Ok)
        });
        let mut gradients: Vec<Tensor> = of_encoder.collect::<Result<_, _>>()?;
        gradients.extend(self.objective.gradients(&store)?);
        Ok((gradients, losses))
    }

    /// The gradients, no longer than asked for, and how long they were.
    fn clipped(&self, gradients: Vec<Tensor>) -> Result<(Vec<Tensor>, f64)> {
        let mut square = [0.0];
        for gradient in &gradients {
            squared_norms(gradient, &mut square)?;
        }
        let norm = square[0].sqrt();
        let Some(largest) = self.config.clip_norm.filter(|&largest| norm > largest) else {
            return Ok((gradients, norm));
        };
        let scale = clip_scales(&square, largest)[0];
        let scaled = gradients.iter().map(|gradient| gradient * scale);
        Ok((scaled.collect::<Result<_, _>>()?, norm))
    }

    /// The losses of the validation images, as the network would embed them in use.
    fn validate(&self, source: &dyn ImageSource) -> Result<Option<Losses>> {
        let surfaces = &self.parts.validation;
        if surfaces.is_empty() {
            return Ok(None);
        }
        let encoder = self.encoder.encoder()?;
        let embed = |&index: &usize| {
            let image = batches::image(source, index)?;
            encoder.embed(&batches::stack(&[image], &[index])?)
        };
        let images = batches::images(surfaces, self.views);
        let embeddings: Vec<Tensor> = images.iter().map(embed).collect::<Result<_>>()?;
        let embeddings = Tensor::cat(&embeddings, 0)?.detach();
        let losses = self.objective.validate(&embeddings, surfaces)?;
        check_finite("validation loss", &losses)?;
        Ok(Some(losses))
    }

    fn keep_if_best(&mut self, validation: Option<Losses>) -> Result<bool> {
        let Some(losses) = validation else {
            return Ok(false);
        };
        let loss = losses.total();
        if self.best.as_ref().is_some_and(|best| best.loss <= loss) {
            return Ok(false);
        }
        self.best = Some(Best {
            epoch: self.history.len() + 1,
            loss,
            weights: self.encoder.weights()?,
        });
        Ok(true)
    }
}

fn check_finite(what: &'static str, losses: &Losses) -> Result<()> {
    let total = losses.total();
    let expected = "a finite loss; a smaller learning rate may help";
    require(total.is_finite(), what, total, expected)
}

fn check(targets: &Targets, parts: &Parts) -> Result<()> {
    let (count, images) = (targets.check()?, parts.training.len());
    require(images >= 2, "training images", images, "at least 2")?;
    let all = parts.training.iter().chain(&parts.validation);
    let largest = all.copied().max().unwrap_or(0);
    let expected = format_args!("below {count}, the number of targets");
    require(largest < count, "image", largest, expected)
}
