//! The losses, each `(trials)`: a weighted sum over the rows of a batch.
//!
//! `weight`, `(trials, rows)`, is one over the number of rows that count, and zero in the others
//! (not measured): so each loss is a mean, and no trial's loss contains another's rows.

use std::iter;

use candle_core::{Device, Result, Tensor};

use super::config::Model;
use super::network::Network;
use super::trained::LossField;
use crate::stacked::{cross_entropy, row_norm, softplus};

/// A batch of each trial of a stack.
pub(super) struct Batch {
    /// `(trials, rows, slots x width)`, scaled.
    pub(super) visual: Tensor,
    /// Features of one slot.
    pub(super) width: usize,
    /// Standardised readings, `(trials, rows, 1)`; any number where the weight is zero.
    pub(super) tactile: Tensor,
    /// `(trials, rows)`.
    pub(super) weight: Tensor,
    /// Classes, by trial and row.
    pub(super) labels: Vec<Option<u32>>,
    /// `(trials, rows)`, over the rows that have a class.
    pub(super) label_weight: Tensor,
}

impl Batch {
    /// From readings and classes, `(trials, rows)`. `measured` and `labelled` say over how many rows each trial's mean
    /// goes.
    pub(super) fn new(
        visual: Tensor,
        width: usize,
        (tactile, measured): (&[Option<f32>], &[f64]),
        (labels, labelled): (Vec<Option<u32>>, &[f64]),
    ) -> Result<Self> {
        let (trials, rows, _) = visual.dims3()?;
        let readings = tactile.iter().map(|reading| reading.unwrap_or(0.0));
        let readings: Vec<f32> = readings.collect();
        Ok(Self {
            visual,
            width,
            tactile: Tensor::from_vec(readings, (trials, rows, 1), &Device::Cpu)?,
            weight: mean_weights(tactile, measured)?,
            label_weight: mean_weights(&labels, labelled)?,
            labels,
        })
    }
}

/// `(trials, rows)`: one over the trial's number in each row there is something of, and zero in the others.
fn mean_weights<T>(values: &[Option<T>], numbers: &[f64]) -> Result<Tensor> {
    let (trials, rows) = (numbers.len(), values.len() / numbers.len().max(1));
    let mut weights = Vec::with_capacity(values.len());
    for (trial, number) in values.chunks(rows.max(1)).zip(numbers) {
        let weight = 1.0 / number.max(1.0) as f32;
        let of = |value: &Option<T>| value.as_ref().map_or(0.0, |_| weight);
        weights.extend(trial.iter().map(of));
    }
    Tensor::from_vec(weights, (trials, rows), &Device::Cpu)
}

/// The losses that there are, each of each trial, `(trials)`, before its weight.
pub(super) struct Losses {
    /// `L_est`.
    estimation: Tensor,
    /// The others, and where each is recorded.
    others: Vec<(LossField, Tensor)>,
}

impl Losses {
    pub(super) fn of(network: &Network, batch: &Batch) -> Result<Self> {
        let (tactile, weight) = (&batch.tactile, &batch.weight);
        let of_estimate = |estimate: &Tensor| -> Result<Self> {
            Ok(Self {
                estimation: squared_error(estimate, tactile, weight)?,
                others: Vec::new(),
            })
        };
        let Network::CrossModal(network) = network else {
            return of_estimate(&network.estimate(&batch.visual)?);
        };
        let seen = network.latent(&batch.visual)?;
        let estimate = network.generator.forward(&seen)?;
        let mut losses = of_estimate(&estimate)?;
        let mut add = |field: LossField, loss| losses.others.push((field, loss));
        if let Some(encoder) = &network.tactile {
            let distance = embedding_distance(&seen, &encoder.forward(tactile)?, weight)?;
            add(|l| &mut l.embedding, distance);
        }
        if let Some(discriminator) = &network.discriminator {
            // No side of the game changes what both look at, where that is trained too.
            let image = batch.visual.narrow(2, 0, batch.width)?.detach();
            let term = discriminator.visual.forward(&image)?;
            let real = discriminator.logit(&term, tactile)?;
            let fake = discriminator.logit(&term, &estimate.detach())?;
            // The generator plays against the discriminator as it is: same logit, but the
            // gradient passes through the estimate alone.
            let faced = discriminator.frozen().logit(&term.detach(), &estimate)?;
            let error = (&estimate - tactile)?;
            let generator = generator_loss(&faced, &error, weight)?;
            add(|l| &mut l.generator, generator);
            let discriminator = discriminator_loss(&real, &fake, weight)?;
            add(|l| &mut l.discriminator, discriminator);
        }
        if let Some(classifier) = &network.classifier {
            let classes = cross_entropy(&classifier.forward(&seen)?, batch.labels.clone())?;
            let loss = weighted(&classes, &batch.label_weight)?;
            add(|l| &mut l.classification, loss);
        }
        Ok(losses)
    }

    /// Those that there are, and where each is recorded.
    pub(super) fn terms(&self) -> impl Iterator<Item = (LossField, &Tensor)> {
        let first: (LossField, _) = (|l| &mut l.estimation, &self.estimation);
        let others = self.others.iter().map(|(field, term)| (*field, term));
        iter::once(first).chain(others)
    }

    /// The sum over the trials of each trial's objective; the discriminator's own loss is added,
    /// for the two sides share no parameter.
    pub(super) fn total(&self, model: &Model) -> Result<Tensor> {
        let mut weights = model.loss_weights();
        let mut total = self.estimation.clone();
        for (field, term) in &self.others {
            total = (total + (term * *field(&mut weights))?)?;
        }
        total.sum_all()
    }
}

/// `sum_i w_i x_i` of each trial.
fn weighted(values: &Tensor, weight: &Tensor) -> Result<Tensor> {
    (values * weight)?.sum(1)
}

/// `L_est = E[(t_est - t)²]`; estimate and truth are `(trials, rows, 1)` and may be swapped.
pub(super) fn squared_error(one: &Tensor, other: &Tensor, weight: &Tensor) -> Result<Tensor> {
    weighted(&(one - other)?.sqr()?.squeeze(2)?, weight)
}

/// `L_emb = E[|e_t - e_v|²]`; the embeddings are `(trials, rows, latent)` and may be swapped.
pub(super) fn embedding_distance(one: &Tensor, other: &Tensor, weight: &Tensor) -> Result<Tensor> {
    weighted(&(one - other)?.sqr()?.sum(2)?, weight)
}

/// The generator's part of `L_adv`: `E[log(1 - D(v, G))] + E[|G - t|]`; `faced` are the logits,
/// `(trials, rows)`, `error` is `G - t`.
pub(super) fn generator_loss(faced: &Tensor, error: &Tensor, weight: &Tensor) -> Result<Tensor> {
    weighted(&(softplus(faced)?.neg()? + row_norm(error)?)?, weight)
}

/// `-E[log D(v, t)] - E[log(1 - D(v, G))]` from the logits, `(trials, rows)`.
pub(super) fn discriminator_loss(real: &Tensor, fake: &Tensor, weight: &Tensor) -> Result<Tensor> {
    weighted(&(softplus(&real.neg()?)? + softplus(fake)?)?, weight)
}
