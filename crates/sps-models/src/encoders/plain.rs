//! Networks composed from candle's own operators, channels first: what the kernels are compared
//! against.

use std::cell::RefCell;
use std::collections::BTreeMap;

use candle_core::{DType, Device, Tensor};
use sps_kernels::network::{Conv, Gate, IMAGE, Layer, MaxPool, Network};
use sps_kernels::training::BatchStatistics;
use sps_kernels::{Activation, Normalisation, Window};

use super::input::check;
use super::{Encoder, TrainableEncoder};
use crate::error::{Error, Result};
use crate::weights::Weights;

impl Encoder {
    /// Embeds images as [`Encoder::embed`] does.
    pub(crate) fn embed_plain(&self, images: &Tensor) -> Result<Tensor> {
        check(&self.network, images)?;
        let images = normalise(images, &self.network.normalisation)?;
        Plain::new(&self.network, &self.weights).embed(&images)
    }
}

impl TrainableEncoder {
    /// Trains by candle's own operators.
    pub(crate) fn with_plain_operators(mut self) -> Self {
        self.plain = true;
        self
    }

    pub(super) fn forward_plain(&mut self, images: &Tensor) -> Result<Tensor> {
        let net = if self.training.running_statistics {
            Plain::new(&self.network, &self.weights)
        } else {
            Plain::training(&self.network, &self.weights)
        };
        let embeddings = net.embed(&normalise(images, &self.network.normalisation)?)?;
        for statistics in net.into_statistics() {
            self.update(&statistics)?;
        }
        Ok(embeddings)
    }
}

pub(super) fn normalise(images: &Tensor, normalisation: &Normalisation) -> Result<Tensor> {
    let row = |values: &[f32; 3]| {
        let row = Tensor::new(values, &Device::Cpu)?.to_dtype(images.dtype())?;
        row.reshape((1, 3, 1, 1))
    };
    let centred = images.broadcast_sub(&row(&normalisation.mean)?)?;
    Ok(centred.broadcast_div(&row(&normalisation.std)?)?)
}

/// A network of images with its weights.
pub(super) struct Plain<'a> {
    network: &'a Network,
    weights: &'a Weights,
    /// In training, what the batch norms saw.
    statistics: Option<RefCell<Vec<BatchStatistics>>>,
}

impl<'a> Plain<'a> {
    /// In inference.
    pub(super) fn new(network: &'a Network, weights: &'a Weights) -> Self {
        Self {
            network,
            weights,
            statistics: None,
        }
    }

    /// In training: batch norm by the batch's own statistics.
    pub(super) fn training(network: &'a Network, weights: &'a Weights) -> Self {
        Self {
            statistics: Some(RefCell::default()),
            ..Self::new(network, weights)
        }
    }

    /// What the batch norms saw, in the order they ran.
    pub(super) fn into_statistics(self) -> Vec<BatchStatistics> {
        self.statistics.map(RefCell::into_inner).unwrap_or_default()
    }

    /// Maps images `(n, 3, height, width)`, normalised, to embeddings `(n, width)`: the means of the
    /// feature maps at the network's depths over space.
    pub(super) fn embed(&self, images: &Tensor) -> Result<Tensor> {
        let maps = self.features(images)?;
        let means = maps.iter().map(|map| map.mean((2, 3)));
        Ok(Tensor::cat(&means.collect::<Result<Vec<_>, _>>()?, 1)?)
    }

    /// Maps such images to the feature maps at the network's depths, `(n, channels, rows, columns)` each.
    pub(super) fn features(&self, images: &Tensor) -> Result<Vec<Tensor>> {
        let last_readers = self.network.last_readers();
        let mut maps = Maps::new();
        maps.insert(IMAGE, images.clone());
        let mut seen = Vec::new();
        for (number, layer) in self.network.layers.iter().enumerate() {
            let map = self.layer(layer, &maps)?;
            if self.network.block(number + 1).is_some() {
                seen.push(map.clone());
            }
            maps.retain(|&map, _| last_readers[map] > number);
            maps.insert(number + 1, map);
        }
        Ok(seen)
    }

    fn layer(&self, layer: &Layer, maps: &Maps) -> Result<Tensor> {
        match layer {
            Layer::Conv(conv) => activate(self.conv(conv, &maps[&conv.input])?, conv.activation),
            Layer::Residual {
                conv,
                gate,
                shortcut,
            } => {
                let mut y = self.conv(conv, &maps[&conv.input])?;
                if let Some(gate) = gate {
                    y = y.broadcast_mul(&self.gate(gate, &y)?)?;
                }
                activate((y + &maps[shortcut])?, conv.activation)
            }
            Layer::Concat(convs) => {
                let part =
                    |conv: &Conv| activate(self.conv(conv, &maps[&conv.input])?, conv.activation);
                let parts: Vec<Tensor> = convs.iter().map(part).collect::<Result<_>>()?;
                Ok(Tensor::cat(&parts, 1)?)
            }
            Layer::MaxPool(pool) => max_pool(pool, &maps[&pool.input]),
        }
    }

    fn tensor(&self, layer: &str, leaf: &str) -> Result<&Tensor> {
        Ok(self.weights.get(&format!("{layer}.{leaf}"))?)
    }

    /// A tensor of one number for each channel, beside maps.
    fn row(&self, layer: &str, leaf: &str) -> Result<Tensor> {
        Ok(self.tensor(layer, leaf)?.reshape((1, (), 1, 1))?)
    }

    /// Convolution with its bias or its batch norm.
    fn conv(&self, conv: &Conv, x: &Tensor) -> Result<Tensor> {
        let window = conv.slide.window(extents(x)?);
        let weight = self.tensor(&conv.name, "weight")?;
        let y = if conv.groups > 1 || x.dtype() == DType::F64 {
            convolve(&pad(x, &window)?, weight, &window, conv.groups)?
        } else {
            let (x, padding) = padded(x, &window)?;
            x.conv2d(weight, padding, window.stride[1], 1, 1)?
        };
        match &conv.norm {
            Some(norm) => self.batch_norm(&y, norm),
            None => Ok(y.broadcast_add(&self.row(&conv.name, "bias")?)?),
        }
    }

    /// Squeeze and excite: `(n, channels, h, w)` to a factor in (0, 1), `(n, channels, 1, 1)`.
    fn gate(&self, gate: &Gate, y: &Tensor) -> Result<Tensor> {
        let linear = |x: &Tensor, layer: &str| -> Result<Tensor> {
            let y = x.conv2d(self.tensor(layer, "weight")?, 0, 1, 1, 1)?;
            Ok(y.broadcast_add(&self.row(layer, "bias")?)?)
        };
        let [hidden, logits] = &gate.layers;
        let hidden = linear(&y.mean_keepdim((2, 3))?, hidden)?.relu()?;
        Ok(candle_nn::ops::sigmoid(&linear(&hidden, logits)?)?)
    }

    /// Batch norm, in inference by running statistics.
    fn batch_norm(&self, x: &Tensor, layer: &str) -> Result<Tensor> {
        if let Some(statistics) = &self.statistics {
            return self.batch_norm_training(x, layer, &mut statistics.borrow_mut());
        }
        let deviation = (self.tensor(layer, "running_var")? + self.network.eps)?.sqrt()?;
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
        BatchStatistics::check_count(count, layer)?;
        let mean = x.mean_keepdim((0, 2, 3))?;
        let centred = x.broadcast_sub(&mean)?;
        let variance = centred.sqr()?.mean_keepdim((0, 2, 3))?;
        statistics.push(BatchStatistics {
            layer: layer.to_owned(),
            mean: numbers(&mean)?,
            variance: numbers(&variance)?,
            count,
        });
        let normed = centred.broadcast_div(&(variance + self.network.eps)?.sqrt()?)?;
        let scaled = normed.broadcast_mul(&self.row(layer, "weight")?)?;
        Ok(scaled.broadcast_add(&self.row(layer, "bias")?)?)
    }
}

/// Feature maps that are still read.
type Maps = BTreeMap<usize, Tensor>;

/// Elements as f32, whatever their type: the reference also runs in f64.
fn numbers(tensor: &Tensor) -> Result<Vec<f32>> {
    Ok(tensor.flatten_all()?.to_dtype(DType::F32)?.to_vec1()?)
}

/// Extents of a map `(n, channels, height, width)`.
fn extents(x: &Tensor) -> Result<[usize; 3]> {
    let (_, _, height, width) = x.dims4()?;
    Ok([1, height, width])
}

fn activate(x: Tensor, activation: Activation) -> Result<Tensor> {
    Ok(match activation {
        Activation::Identity => x,
        Activation::Relu => x.relu()?,
        Activation::Relu6 => x.relu()?.minimum(6.0)?,
    })
}

/// A map and the padding that a convolution is to add: what is not alike on all sides is added here.
fn padded(x: &Tensor, window: &Window) -> Result<(Tensor, usize)> {
    let [_, top, left] = window.before;
    if window.after == window.before && top == left {
        return Ok((x.clone(), top));
    }
    Ok((pad(x, window)?, 0))
}

/// A map with a window's padding of zeros.
fn pad(x: &Tensor, window: &Window) -> Result<Tensor> {
    let x = x.pad_with_zeros(2, window.before[1], window.after[1])?;
    Ok(x.pad_with_zeros(3, window.before[2], window.after[2])?)
}

/// `count` rows or columns, the first of them `first` and each `stride` after the one before it; beyond the edge, the last
/// one again.
fn strided(
    x: &Tensor,
    dim: usize,
    (first, stride): (usize, usize),
    count: usize,
) -> Result<Tensor> {
    let last = x.dim(dim)? - 1;
    if stride == 1 && first + count <= last + 1 {
        return Ok(x.narrow(dim, first, count)?);
    }
    let places = (0..count).map(|i| (first + i * stride).min(last) as u32);
    Ok(x.index_select(&Tensor::from_iter(places, x.device())?, dim)?)
}

/// Convolution of a padded map: one product a group, or with one channel in each, a window's pixel at a time. Candle's
/// own computes groups one by one, adds maps of all groups for each in its backward pass, and has no vectors for f64 there.
fn convolve(x: &Tensor, weight: &Tensor, window: &Window, groups: usize) -> Result<Tensor> {
    let (outputs, inputs, height, width) = weight.dims4()?;
    let ([_, down, right], [_, rows, columns]) = (window.stride, extents(x)?);
    let count = [(rows - height) / down + 1, (columns - width) / right + 1];
    let x = x.transpose(0, 1)?.contiguous()?;
    let mut pixels = Vec::new();
    for row in 0..height {
        let rows = strided(&x, 2, (row, down), count[0])?;
        for column in 0..width {
            pixels.push(strided(&rows, 3, (column, right), count[1])?);
        }
    }
    let each = inputs * pixels.len();
    let y = if inputs == 1 {
        let weight = weight.reshape((outputs, each, 1, 1, 1))?;
        let product = |(i, x): (usize, &Tensor)| x.broadcast_mul(&weight.get_on_dim(1, i)?);
        let products = pixels.iter().enumerate().map(product);
        products.reduce(|a, b| a? + b?).unwrap_or(Ok(x))?
    } else {
        let pixels = Tensor::stack(&pixels, 1)?.reshape((groups, each, ()))?;
        let y = weight.reshape((groups, (), each))?.matmul(&pixels)?;
        y.reshape((outputs, (), count[0], count[1]))?
    };
    Ok(y.transpose(0, 1)?.contiguous()?)
}

/// Max pooling by operators that have gradients where windows overlap: candle's own has none.
fn max_pool(pool: &MaxPool, x: &Tensor) -> Result<Tensor> {
    let size = extents(x)?;
    let window = pool.slide.window(size);
    let Some([_, rows, columns]) = pool.output(size) else {
        let found = format_args!("a map of {size:?}");
        return Err(Error::input("images", found, "larger ones"));
    };
    let x = pad(x, &window)?;
    let Window { size, stride, .. } = window;
    let x = largest_of_rows(&x, 2, (size[1], stride[1]), rows)?;
    largest_of_rows(&x, 3, (size[2], stride[2]), columns)
}

/// Max pooling along one axis to `count` places by a window of such a size and stride. What hangs over the edge sees
/// the last row.
fn largest_of_rows(
    x: &Tensor,
    dim: usize,
    (window, stride): (usize, usize),
    count: usize,
) -> Result<Tensor> {
    let mut largest: Option<Tensor> = None;
    for offset in 0..window {
        let rows = strided(x, dim, (offset, stride), count)?;
        largest = Some(match largest {
            Some(largest) => largest.maximum(&rows)?,
            None => rows,
        });
    }
    Ok(largest.unwrap_or_else(|| x.clone()))
}
