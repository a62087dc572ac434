//! Layers composed from candle's own operators, channels first: what the fused operators are
//! compared against, and what runs on devices other than the CPU.

use std::cell::RefCell;

use candle_core::{DType, Tensor};

use super::{EncoderKind, se_resnext, squeezenet};
use crate::error::{Error, Result};
use crate::weights::Weights;

/// What batch norm adds to a variance.
pub(super) const BATCH_NORM_EPS: f64 = 1e-5;

/// What one batch tells of a batch norm's input.
#[derive(Debug, Clone)]
pub(super) struct BatchStatistics {
    /// The batch norm's name.
    pub(super) layer: String,
    /// `(channels)`
    pub(super) mean: Vec<f32>,
    /// `(channels)`, over the count.
    pub(super) variance: Vec<f32>,
    /// Numbers in one channel.
    pub(super) count: usize,
}

/// Layers of a network.
pub(super) struct Plain<'a> {
    weights: &'a Weights,
    /// In training, what the batch norms saw.
    statistics: Option<RefCell<Vec<BatchStatistics>>>,
}

impl<'a> Plain<'a> {
    /// Layers in inference.
    pub(super) fn new(weights: &'a Weights) -> Self {
        Self {
            weights,
            statistics: None,
        }
    }

    /// Layers in training: batch norm by the batch's own statistics.
    pub(super) fn training(weights: &'a Weights) -> Self {
        Self {
            weights,
            statistics: Some(RefCell::default()),
        }
    }

    /// What the batch norms saw, in the order they ran.
    pub(super) fn into_statistics(self) -> Vec<BatchStatistics> {
        self.statistics.map(RefCell::into_inner).unwrap_or_default()
    }

    /// Maps images `(n, 3, height, width)`, normalised, to embeddings `(n, width)`: the mean of the
    /// last feature map over space.
    pub(super) fn embed(&self, kind: EncoderKind, images: &Tensor) -> Result<Tensor> {
        Ok(self.features(kind, images)?.mean((2, 3))?)
    }

    /// Maps such images to the last feature map, `(n, width, rows, columns)`.
    pub(super) fn features(&self, kind: EncoderKind, images: &Tensor) -> Result<Tensor> {
        match kind.se_resnext() {
            Some(config) => se_resnext::plain::features(&config, self, images),
            None => squeezenet::plain::features(self, images),
        }
    }

    fn tensor(&self, layer: &str, leaf: &str) -> Result<&Tensor> {
        Ok(self.weights.get(&format!("{layer}.{leaf}"))?)
    }

    /// Convolution by `{layer}.weight`, and `{layer}.bias` where there is one.
    pub(super) fn conv(
        &self,
        x: &Tensor,
        layer: &str,
        stride: usize,
        padding: usize,
        groups: usize,
    ) -> Result<Tensor> {
        let y = x.conv2d(self.tensor(layer, "weight")?, padding, stride, 1, groups)?;
        match self.tensor(layer, "bias") {
            Ok(bias) => Ok(y.broadcast_add(&bias.reshape((1, (), 1, 1))?)?),
            Err(_) => Ok(y),
        }
    }

    /// Batch norm, in inference by running statistics.
    pub(super) fn batch_norm(&self, x: &Tensor, layer: &str) -> Result<Tensor> {
        if let Some(statistics) = &self.statistics {
            return self.batch_norm_training(x, layer, &mut statistics.borrow_mut());
        }
        let deviation = (self.tensor(layer, "running_var")? + BATCH_NORM_EPS)?.sqrt()?;
        let scale = self.tensor(layer, "weight")?.div(&deviation)?;
        let shift =
            (self.tensor(layer, "bias")? - (self.tensor(layer, "running_mean")? * &scale)?)?;
        let scaled = x.broadcast_mul(&scale.reshape((1, (), 1, 1))?)?;
        Ok(scaled.broadcast_add(&shift.reshape((1, (), 1, 1))?)?)
    }

    fn batch_norm_training(
        &self,
        x: &Tensor,
        layer: &str,
        statistics: &mut Vec<BatchStatistics>,
    ) -> Result<Tensor> {
        let count = x.elem_count() / x.dim(1)?;
        check_count(count, layer)?;
        let mean = x.mean_keepdim((0, 2, 3))?;
        let centred = x.broadcast_sub(&mean)?;
        let variance = centred.sqr()?.mean_keepdim((0, 2, 3))?;
        statistics.push(BatchStatistics {
            layer: layer.to_owned(),
            mean: numbers(&mean)?,
            variance: numbers(&variance)?,
            count,
        });
        let normed = centred.broadcast_div(&(variance + BATCH_NORM_EPS)?.sqrt()?)?;
        let scaled =
            normed.broadcast_mul(&self.tensor(layer, "weight")?.reshape((1, (), 1, 1))?)?;
        let shift = self.tensor(layer, "bias")?.reshape((1, (), 1, 1))?;
        Ok(scaled.broadcast_add(&shift)?)
    }

    /// Max pooling without padding in ceil mode: the last window may hang over the edge.
    pub(super) fn max_pool(&self, x: &Tensor, window: usize, stride: usize) -> Result<Tensor> {
        let (_, _, height, width) = x.dims4()?;
        if self.statistics.is_some() {
            let rows = largest_of_rows(x, 2, window, stride)?;
            return largest_of_rows(&rows, 3, window, stride);
        }
        let x = pad_end(x, 2, pooled(height, window, stride).1)?;
        let x = pad_end(&x, 3, pooled(width, window, stride).1)?;
        Ok(x.max_pool2d_with_stride(window, stride)?)
    }
}

/// Elements as f32, whatever their type: the reference also runs in f64.
fn numbers(tensor: &Tensor) -> Result<Vec<f32>> {
    Ok(tensor.flatten_all()?.to_dtype(DType::F32)?.to_vec1()?)
}

/// Batch norm in training needs a spread.
pub(super) fn check_count(count: usize, layer: &str) -> Result<()> {
    if count >= 2 {
        return Ok(());
    }
    Err(Error::input(
        "batch in training",
        format_args!("one number in each channel at {layer}"),
        "at least two: more images or larger ones",
    ))
}

/// Max pooling along one axis, by operators that have gradients where windows overlap: candle's
/// max pooling has none.
fn largest_of_rows(x: &Tensor, dim: usize, window: usize, stride: usize) -> Result<Tensor> {
    let extent = x.dim(dim)?;
    let count = pooled(extent, window, stride).0;
    let mut largest: Option<Tensor> = None;
    for offset in 0..window {
        let rows = (0..count).map(|i| (i * stride + offset).min(extent - 1) as u32);
        let rows = Tensor::from_iter(rows, x.device())?;
        let rows = x.index_select(&rows, dim)?;
        largest = Some(match largest {
            Some(largest) => largest.maximum(&rows)?,
            None => rows,
        });
    }
    Ok(largest.unwrap_or_else(|| x.clone()))
}

/// The extent after pooling in ceil mode, and how far the last window hangs over.
///
/// An extent of 1 is pooled to 1, where PyTorch refuses.
pub(super) fn pooled(extent: usize, window: usize, stride: usize) -> (usize, usize) {
    let out = extent.saturating_sub(window).div_ceil(stride) + 1;
    (out, ((out - 1) * stride + window).saturating_sub(extent))
}

/// Repeats the last row or column: what max pooling needs, since it changes no maximum.
fn pad_end(x: &Tensor, dim: usize, by: usize) -> Result<Tensor> {
    if by == 0 {
        return Ok(x.clone());
    }
    let last = x.narrow(dim, x.dim(dim)? - 1, 1)?;
    let mut parts = vec![x.clone()];
    parts.extend(std::iter::repeat_n(last, by));
    Ok(Tensor::cat(&parts, dim)?)
}
