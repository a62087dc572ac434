//! What an encoder is trained by.

mod linear;
#[cfg(test)]
mod tests;

use candle_core::backprop::GradStore;
use candle_core::{Tensor, Var};
use serde::{Deserialize, Serialize};
use sps_regress::TrainingData;

use super::config::{TrainingConfig, TrainingObjective, head};
use super::targets::Targets;
use crate::error::{Error, Result, require};
use crate::heads::{Draw, EpochLosses, JointHeads, Share};
use linear::{Layer, Linear};

/// What stands on the embedding while the encoder is trained, and the loss of what it says.
#[derive(Debug)]
pub(super) enum Objective {
    Linear(Linear),
    Heads {
        heads: Box<JointHeads>,
        /// How much each of its losses counts.
        weights: EpochLosses,
    },
}

/// Parts of a loss, each times its weight; their sum is what training makes small.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub struct Losses {
    /// Mean squared error of the values, in units of their variance in training.
    pub values: f64,
    /// Cross-entropy of the classes, in nats.
    pub classes: f64,
    /// Share of images whose class has the highest score; no part of the sum, and 0 where heads are
    /// trained.
    pub accuracy: f64,
    /// Of features that are kept: their mean squared error, in units of their variance.
    pub kept: f64,
    /// `L_emb` of the heads.
    pub embedding: f64,
    /// The generator's part of `L_adv`.
    pub generator: f64,
    /// The discriminator's part of `L_adv`, as it is minimised.
    pub discriminator: f64,
}

impl Losses {
    /// Its fields; the first is no part of the sum.
    const FIELDS: [fn(&mut Self) -> &mut f64; 7] = [
        |l| &mut l.accuracy,
        |l| &mut l.values,
        |l| &mut l.classes,
        |l| &mut l.kept,
        |l| &mut l.embedding,
        |l| &mut l.generator,
        |l| &mut l.discriminator,
    ];

    /// What training makes small.
    pub fn total(&self) -> f64 {
        let mut own = *self;
        let parts = Self::FIELDS[1..].iter().map(|field| *field(&mut own));
        parts.sum()
    }

    pub(super) fn add(&mut self, other: &Self, weight: f64) {
        let mut other = *other;
        for field in Self::FIELDS {
            *field(self) += weight * *field(&mut other);
        }
    }

    fn of_heads(losses: &EpochLosses, weights: &EpochLosses) -> Self {
        Self {
            values: weights.estimation * losses.estimation,
            classes: weights.classification * losses.classification,
            embedding: weights.embedding * losses.embedding,
            generator: weights.generator * losses.generator,
            discriminator: weights.discriminator * losses.discriminator,
            ..Self::default()
        }
    }
}

impl Objective {
    pub(super) fn new(
        config: &TrainingConfig,
        targets: Targets,
        training: &[usize],
        width: usize,
        seed: u64,
    ) -> Result<Self> {
        if let Some(start) = &targets.start {
            let found = (start.views(), start.width());
            // Of the views that are shown, and by this encoder.
            let expected = (config.objective.views(), width);
            let seen = |(views, width): (usize, usize)| format!("{views} views of width {width}");
            let what = "what the encoder sees at the start";
            require(found == expected, what, seen(found), seen(expected))?;
        }
        Ok(match &config.objective {
            TrainingObjective::Linear {} => {
                let values = (targets.values, targets.classes);
                Self::Linear(Linear::new(values, training, width, seed)?)
            }
            TrainingObjective::Heads {
                input,
                scale,
                model,
                ..
            } => {
                let head = head(input, *scale, model);
                let heads = JointHeads::new(head, &tables(&targets)?, training, seed)?;
                Self::Heads {
                    heads: Box::new(heads),
                    weights: model.loss_weights(),
                }
            }
        })
    }

    /// The parameters, by name.
    pub(super) fn parameters(&self) -> impl Iterator<Item = (String, &Var)> {
        let parameters: Vec<(String, &Var)> = match self {
            Self::Linear(linear) => linear.layers().flat_map(Layer::parameters).collect(),
            Self::Heads { heads, .. } => heads.parameters().collect(),
        };
        parameters.into_iter()
    }

    /// The loss of `embeddings`, `(surfaces x views, width)`, of some surfaces of step `step`: as a tensor
    /// to differentiate, and its parts as numbers.
    pub(super) fn loss(
        &self,
        embeddings: &Tensor,
        share: Share<'_>,
        step: usize,
    ) -> Result<(Tensor, Losses)> {
        match self {
            Self::Linear(linear) => linear.loss(embeddings, share),
            Self::Heads { heads, weights } => {
                let seen = by_view(embeddings, heads.views())?;
                let (loss, losses) = heads.loss(&seen, share, Draw::Step(step))?;
                Ok((loss, Losses::of_heads(&losses, weights)))
            }
        }
    }

    /// What says how good an encoder is that embeds these surfaces so. Of heads it is the error of
    /// their values alone: those of a game say nothing of how good a player is, and clusters have no
    /// member that is not trained on.
    pub(super) fn validate(&self, embeddings: &Tensor, surfaces: &[usize]) -> Result<Losses> {
        match self {
            Self::Linear(linear) => Ok(linear.loss(embeddings, Share::whole(surfaces))?.1),
            Self::Heads { heads, .. } => {
                let seen = by_view(embeddings, heads.views())?;
                Ok(Losses {
                    values: heads.error(&seen, surfaces)?,
                    ..Losses::default()
                })
            }
        }
    }

    /// The parameters' gradients after a backward pass, in their order; `store` is what candle says.
    pub(super) fn gradients(&self, store: &GradStore) -> Result<Vec<Tensor>> {
        let of = |(_, variable): (String, &Var)| match store.get(variable) {
            Some(gradient) => Ok(gradient.clone()),
            // Adam does not move what never had a gradient.
            None => variable.zeros_like(),
        };
        let mut gradients = match self {
            Self::Linear(_) => Vec::new(),
            Self::Heads { heads, .. } => heads.gradients()?,
        };
        let others = self.parameters().skip(gradients.len()).map(of);
        gradients.extend(others.collect::<candle_core::Result<Vec<_>>>()?);
        Ok(gradients)
    }
}

/// `(surfaces, views, width)`.
fn by_view(embeddings: &Tensor, views: usize) -> Result<Tensor> {
    Ok(embeddings.reshape(((), views, embeddings.dim(1)?))?)
}

/// What heads learn from.
fn tables(targets: &Targets) -> Result<TrainingData<'_>> {
    let (Some(readings), Some(start)) = (&targets.values, &targets.start) else {
        let expected = "values and what the encoder sees at the start, for heads";
        return Err(Error::input("targets", "none", expected));
    };
    let expected = "none: heads form their labels themselves";
    require(targets.classes.is_none(), "targets", "classes", expected)?;
    let data = TrainingData::new(start, readings);
    Ok(match &targets.materials {
        Some(materials) => data.with_materials(materials),
        None => data,
    })
}

/// A loss of nothing.
fn nothing(like: &Tensor) -> candle_core::Result<Tensor> {
    Tensor::zeros((), like.dtype(), like.device())
}
