//! What an encoder is trained by.

mod linear;
#[cfg(test)]
mod tests;

use std::ops::Range;

use candle_core::backprop::GradStore;
use candle_core::{Device, Tensor, Var};
use serde::{Deserialize, Serialize};
use sps_regress::{TrainingData, places};

use super::batches;
use super::config::{TrainingConfig, TrainingObjective, head};
use super::targets::{Features, Targets};
use crate::encoders::Block;
use crate::error::{Error, Result, require};
use crate::heads::{Draw, EpochLosses, JointHeads, Share};
use linear::{Layer, Linear};

/// What stands on the embedding while the encoder is trained, and the loss of what it says.
#[derive(Debug)]
pub(super) struct Objective {
    base: Base,
    features: Option<Taught>,
}

#[derive(Debug)]
enum Base {
    Linear(Linear),
    Heads {
        heads: Box<JointHeads>,
        /// How much each of its losses counts.
        weights: EpochLosses,
    },
}

/// What a teacher's features are learnt by.
#[derive(Debug)]
struct Taught {
    /// Standardised, `(images, width)`.
    features: Tensor,
    weight: f64,
    blocks: Vec<TaughtBlock>,
}

/// One of the teacher's depths.
#[derive(Debug)]
struct TaughtBlock {
    /// Its place in the teacher's embeddings.
    wanted: Range<usize>,
    /// The place in the encoder's that it is learnt from.
    from: Range<usize>,
    layer: Layer,
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
    /// Mean squared error of another encoder's features, in units of their variance in training.
    pub features: f64,
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
        |l| &mut l.features,
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
        encoder: &[Block],
        seed: u64,
    ) -> Result<Self> {
        let width = encoder.iter().map(|block| block.width).sum();
        let images = batches::images(training, targets.views());
        if let Some(start) = &targets.start {
            let found = (start.views(), start.width());
            // Of the views that are shown, and by this encoder.
            let expected = (config.objective.views(), width);
            let seen = |(views, width): (usize, usize)| format!("{views} views of width {width}");
            let what = "what the encoder sees at the start";
            require(found == expected, what, seen(found), seen(expected))?;
        }
        let taught = taught_by(&targets, config.distillation)?;
        let base = match &config.objective {
            TrainingObjective::Linear {} => {
                let values = (targets.values, targets.classes);
                Base::Linear(Linear::new(values, training, width, seed)?)
            }
            TrainingObjective::Heads {
                input,
                scale,
                model,
                ..
            } => {
                let head = head(input, *scale, model);
                let heads = JointHeads::new(head, &tables(&targets)?, training, seed)?;
                Base::Heads {
                    heads: Box::new(heads),
                    weights: model.loss_weights(),
                }
            }
        };
        let features = taught.map(|features| {
            Ok::<_, Error>(Taught {
                features: features.standardised(&images)?,
                weight: features.weight,
                blocks: taught_blocks(&features, encoder, seed)?,
            })
        });
        let features = features.transpose()?;
        Ok(Self { base, features })
    }

    /// The parameters, by name.
    pub(super) fn parameters(&self) -> impl Iterator<Item = (String, &Var)> {
        let features = self.features.iter().flat_map(|taught| &taught.blocks);
        let mut parameters: Vec<(String, &Var)> = match &self.base {
            Base::Linear(linear) => linear.layers().flat_map(Layer::parameters).collect(),
            Base::Heads { heads, .. } => heads.parameters().collect(),
        };
        parameters.extend(features.flat_map(|block| block.layer.parameters()));
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
        let (loss, losses) = match &self.base {
            Base::Linear(linear) => linear.loss(embeddings, share)?,
            Base::Heads { heads, weights } => {
                let seen = by_view(embeddings, heads.views())?;
                let (loss, losses) = heads.loss(&seen, share, Draw::Step(step))?;
                (loss, Losses::of_heads(&losses, weights))
            }
        };
        self.with_features(embeddings, share, loss, losses)
    }

    /// What says how good an encoder is that embeds these surfaces so. Of heads it is the error of
    /// their values alone: those of a game say nothing of how good a player is, and clusters have no
    /// member that is not trained on.
    pub(super) fn validate(&self, embeddings: &Tensor, surfaces: &[usize]) -> Result<Losses> {
        match &self.base {
            Base::Linear(linear) => {
                let whole = Share::whole(surfaces);
                let (loss, losses) = linear.loss(embeddings, whole)?;
                let (_, losses) = self.with_features(embeddings, whole, loss, losses)?;
                Ok(losses)
            }
            Base::Heads { heads, .. } => {
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
        let mut gradients = match &self.base {
            Base::Linear(_) => Vec::new(),
            Base::Heads { heads, .. } => heads.gradients()?,
        };
        let others = self.parameters().skip(gradients.len()).map(of);
        gradients.extend(others.collect::<candle_core::Result<Vec<_>>>()?);
        Ok(gradients)
    }

    /// Adds the loss of a teacher's features.
    fn with_features(
        &self,
        embeddings: &Tensor,
        share: Share<'_>,
        loss: Tensor,
        mut losses: Losses,
    ) -> Result<(Tensor, Losses)> {
        let Some(taught) = &self.features else {
            return Ok((loss, losses));
        };
        let of_features = taught.loss(embeddings, share)?;
        losses.features = f64::from(of_features.to_scalar::<f32>()?);
        Ok(((loss + of_features)?, losses))
    }
}

impl Taught {
    /// The mean over the blocks of the mean squared error of their features.
    fn loss(&self, embeddings: &Tensor, Share { surfaces, of }: Share<'_>) -> Result<Tensor> {
        let images = embeddings.dim(0)?;
        let views = images / surfaces.len().max(1);
        let images = batches::images(surfaces, views);
        let rows: Vec<u32> = images.iter().map(|&image| image as u32).collect();
        let rows = Tensor::new(rows, embeddings.device())?;
        let wanted = self.features.index_select(&rows, 0)?;
        let mut sum = nothing(embeddings)?;
        for block in &self.blocks {
            let wanted = wanted.narrow(1, block.wanted.start, block.wanted.len())?;
            let seen = embeddings.narrow(1, block.from.start, block.from.len())?;
            let error = block.layer.apply(&seen)?.sub(&wanted)?;
            let count = of.len() * views * block.wanted.len() * self.blocks.len();
            sum = (sum + (error.sqr()?.sum_all()? / count as f64)?)?;
        }
        Ok((sum * self.weight)?)
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

/// What is learnt by features: a teacher's, or what the encoder itself saw at the start.
fn taught_by(targets: &Targets, distillation: f64) -> Result<Option<Features>> {
    if distillation == 0.0 {
        return Ok(targets.features.clone());
    }
    let Some(start) = &targets.start else {
        let expected = "what the encoder sees at the start, for distillation";
        return Err(Error::input("targets", "none", expected));
    };
    let (alone, found) = (targets.features.is_none(), "features of another encoder");
    require(alone, "targets", found, "none beside distillation")?;
    let shape = (start.surfaces() * start.views(), start.width());
    Ok(Some(Features {
        embeddings: Tensor::from_slice(start.values(), shape, &Device::Cpu)?,
        blocks: Vec::new(),
        weight: distillation,
    }))
}

/// What each of a teacher's blocks is learnt from, and by.
fn taught_blocks(features: &Features, encoder: &[Block], seed: u64) -> Result<Vec<TaughtBlock>> {
    let placed = |blocks: &[Block]| -> Vec<(String, Range<usize>)> {
        let places = places(blocks.iter().map(|block| block.width));
        let names = blocks.iter().map(|block| block.name.clone());
        names.zip(places).collect()
    };
    let own = placed(encoder);
    let all = 0..own.last().map_or(0, |(_, range)| range.end);
    let block = |name: &str, wanted: Range<usize>, from: Range<usize>| {
        let layer = Layer::new(name, from.len(), wanted.len(), seed)?;
        Ok(TaughtBlock {
            wanted,
            from,
            layer,
        })
    };
    if features.blocks.is_empty() {
        let wanted = 0..features.embeddings.dim(1)?;
        return Ok(vec![block("features", wanted, all)?]);
    }
    let named = placed(&features.blocks).into_iter().map(|(name, wanted)| {
        let same = own.iter().find(|(other, _)| *other == name);
        let from = same.map_or_else(|| all.clone(), |(_, range)| range.clone());
        block(&format!("features.{name}"), wanted, from)
    });
    named.collect()
}

/// A loss of nothing.
fn nothing(like: &Tensor) -> candle_core::Result<Tensor> {
    Tensor::zeros((), like.dtype(), like.device())
}
