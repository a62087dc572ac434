//! Linear layers from embedding to values and class scores.

use candle_core::{D, Device, Tensor, Var};
use candle_nn::ops::log_softmax;
use rand::Rng;
use sps_base::streams::named_stream;
use sps_regress::Readings;

use super::{Losses, nothing};
use crate::error::{Error, Result};
use crate::heads::Share;
use crate::training::targets::{Classes, Standards};

/// The mean squared error of the standardised values, plus the cross-entropy of the classes, each a
/// mean over the batch.
#[derive(Debug)]
pub(crate) struct Linear {
    values: Option<(Standards, Layer)>,
    classes: Option<(Classes, Layer)>,
}

impl Linear {
    pub(super) fn new(
        (values, classes): (Option<Readings>, Option<Classes>),
        training: &[usize],
        width: usize,
        seed: u64,
    ) -> Result<Self> {
        let layer = |name: &str, outputs| Layer::new(name, width, outputs, seed);
        let of_values = |readings: Readings| {
            let layer = layer("values", readings.properties().len())?;
            Ok::<_, Error>((Standards::of(readings, training), layer))
        };
        let of_classes = |classes: Classes| {
            let layer = layer("classes", classes.count as usize)?;
            Ok::<_, Error>((classes, layer))
        };
        Ok(Self {
            values: values.map(of_values).transpose()?,
            classes: classes.map(of_classes).transpose()?,
        })
    }

    pub(super) fn layers(&self) -> impl Iterator<Item = &Layer> {
        let values = self.values.iter().map(|(_, layer)| layer);
        values.chain(self.classes.iter().map(|(_, layer)| layer))
    }

    /// The loss of `embeddings`, `(images, width)`, of the given images: as a tensor to
    /// differentiate, and its parts as numbers.
    pub(super) fn loss(&self, embeddings: &Tensor, share: Share<'_>) -> Result<(Tensor, Losses)> {
        let (images, of) = (share.surfaces, share.of);
        let mut losses = Losses::default();
        let mut total = nothing(embeddings)?;
        if let Some((standards, layer)) = &self.values {
            let (values, present) = standards.tensors(images)?;
            let error = layer.apply(embeddings)?.sub(&values)?;
            let squares = (error.sqr()? * present)?;
            let loss = (squares.sum_all()? / standards.count(of).max(1) as f64)?;
            losses.values = f64::from(loss.to_scalar::<f32>()?);
            total = (total + loss)?;
        }
        if let Some((classes, layer)) = &self.classes {
            let labels: Vec<u32> = images.iter().map(|&i| classes.of_image[i]).collect();
            let labels = Tensor::new(labels, embeddings.device())?;
            let scores = layer.apply(embeddings)?;
            let best = scores.detach().argmax(D::Minus1)?;
            let right = best.eq(&labels)?.to_dtype(embeddings.dtype())?;
            let share = (right.sum_all()? / of.len() as f64)?;
            losses.accuracy = f64::from(share.to_scalar::<f32>()?);
            let own = log_softmax(&scores, D::Minus1)?.gather(&labels.unsqueeze(1)?, 1)?;
            let loss = (own.sum_all()? / of.len() as f64)?.neg()?;
            losses.classes = f64::from(loss.to_scalar::<f32>()?);
            total = (total + loss)?;
        }
        Ok((total, losses))
    }
}

/// `x W^T + b`.
#[derive(Debug)]
pub(super) struct Layer {
    name: String,
    weight: Var,
    bias: Var,
}

impl Layer {
    /// Filled as PyTorch fills a linear layer: uniformly within 1 / sqrt(width).
    pub(super) fn new(name: &str, width: usize, outputs: usize, seed: u64) -> Result<Self> {
        let bound = 1.0 / (width as f32).sqrt();
        let draw = |leaf: &str, shape: &[usize]| {
            let mut rng = named_stream(seed, &format!("training/init/{name}.{leaf}"), 0);
            let values = (0..shape.iter().product()).map(|_| rng.random_range(-bound..bound));
            let values = Tensor::from_vec(values.collect::<Vec<f32>>(), shape, &Device::Cpu)?;
            Var::from_tensor(&values)
        };
        Ok(Self {
            name: name.to_owned(),
            weight: draw("weight", &[outputs, width])?,
            bias: draw("bias", &[outputs])?,
        })
    }

    pub(super) fn parameters(&self) -> [(String, &Var); 2] {
        let name = |leaf: &str| format!("{}.{leaf}", self.name);
        [(name("weight"), &self.weight), (name("bias"), &self.bias)]
    }

    pub(super) fn apply(&self, x: &Tensor) -> Result<Tensor> {
        let products = x.matmul(&self.weight.as_tensor().t()?)?;
        Ok(products.broadcast_add(self.bias.as_tensor())?)
    }
}
