//! A convolution and its norm or bias, forward and backward.

use super::layer::{Context, Gradients, output};
use super::{Value, segment::MapGradients};
use crate::error::Result;
use crate::network::{Conv, IMAGE};
use crate::ops::activated::activation_gradient;
use crate::ops::batch_norm::{Norm, NormGradients};
use crate::ops::buffer::Scratch;
use crate::ops::conv_input::ConvTranspose;
use crate::ops::grid::Grid;
use crate::ops::product::Epilogue;
use crate::ops::statistics::ChannelStatistics;
use crate::ops::words::Real;
use crate::training::BatchStatistics;

/// A convolution's output and the norm of it.
#[derive(Debug)]
pub(super) struct KeptConv<W: Real> {
    pub(super) raw: Scratch<W>,
    pub(super) grid: Grid,
    pub(super) norm: Norm,
    pub(super) moments: ChannelStatistics,
}

impl<W: Real> KeptConv<W> {
    /// Runs forward up to the norm.
    pub(super) fn record(
        context: &Context,
        (conv, norm): (&Conv, &str),
        source: &Value<W>,
        statistics: Option<&mut Vec<BatchStatistics>>,
    ) -> Result<Self> {
        let grid = output::<W>(conv, &source.grid)?;
        let mut raw = context.recycler.take(grid.len());
        let target = (&mut raw[..], &grid);
        context.convolve(conv, source.view(), target, Epilogue::default())?;
        let (norm, moments) = context.norm(norm, (&raw[..], &grid), statistics)?;
        Ok(Self {
            raw,
            grid,
            norm,
            moments,
        })
    }

    /// The mean over space of the norm, `(frames, channels)`: the norm of the mean.
    pub(super) fn squeeze(&self) -> Vec<f32> {
        let Norm {
            mean, factor, beta, ..
        } = &self.norm;
        let means = &self.moments.frame_means;
        let norm = |(i, x): (usize, &f32)| {
            let c = i % mean.len();
            (x - mean[c]) * factor[c] + beta[c]
        };
        means.iter().enumerate().map(norm).collect()
    }

    /// Memory and layout of what the norm is of.
    pub(super) fn raw(&self) -> (&[W], &Grid) {
        (&self.raw, &self.grid)
    }

    /// Runs backward, from the gradient of the activated norm, which lies as the output.
    pub(super) fn backward(
        &self,
        (context, conv, norm): (&Context, &Conv, &str),
        source: &Value<W>,
        gradient: &[W],
        of_maps: &mut MapGradients<W>,
        gradients: &mut Gradients,
    ) -> Result<()> {
        let (level, activation) = (context.level, conv.activation);
        let (grid, of_this) = (&self.grid, &self.norm);
        let sums = of_this.sums(level, &self.raw, gradient, grid, activation);
        let sums = sums.over_frames(grid.channels);
        let of_norm = NormGradients::new(of_this, self.moments.count, &sums);
        let slopes = of_norm.slopes.clone();
        gradients.norm(norm, of_norm);
        let write = |target: &mut [W], layout: &Grid| {
            let (ends, target) = ([&self.raw[..], gradient], (target, layout));
            of_this.backward(level, &slopes, ends, target, Some(activation));
        };
        input_gradient((context, conv), grid, source, of_maps, gradients, write)
    }
}

/// Runs a convolution with a bias backward, from the gradient of its activated output, whose map both begin with its
/// channels.
pub(super) fn biased_backward<W: Real>(
    (context, conv): (&Context, &Conv),
    source: &Value<W>,
    activated: (&[W], &Grid),
    gradient: &[W],
    of_maps: &mut MapGradients<W>,
    gradients: &mut Gradients,
) -> Result<()> {
    let grid = output::<W>(conv, &source.grid)?;
    let mut sums = Vec::new();
    let write = |target: &mut [W], layout: &Grid| {
        let target = (target, layout);
        sums = activation_gradient(context.level, conv.activation, activated, gradient, target);
    };
    input_gradient((context, conv), &grid, source, of_maps, gradients, write)?;
    let bias = sums.into_iter().map(|sum| sum as f32).collect();
    gradients.insert(&conv.name, "bias", bias);
    Ok(())
}

/// Notes the gradient of the weights, and adds that of the input, from that of the output, which lies as `grid` says
/// and which `write` writes into memory of such a layout.
pub(super) fn input_gradient<W: Real>(
    (context, conv): (&Context, &Conv),
    grid: &Grid,
    source: &Value<W>,
    of_maps: &mut MapGradients<W>,
    gradients: &mut Gradients,
    write: impl FnOnce(&mut [W], &Grid),
) -> Result<()> {
    let shape = conv.shape(source.grid.size);
    if conv.input == IMAGE {
        let mut target = context.recycler.take(grid.len());
        write(&mut target, grid);
        let gradient = (&target[..], grid);
        context.weight_gradient(conv, &shape, source.view(), gradient, gradients);
        return Ok(());
    }
    let transpose = context.parameter(&format!("{}.weight", conv.name), |weights| {
        ConvTranspose::<W>::pack(context.level, shape, weights)
    })?;
    let layout = transpose.layout(grid.frames, source.grid.size, grid.size);
    let layout = layout.staggered();
    let mut target = context.recycler.take(layout.len());
    layout.fill_border(&mut target, W::default());
    write(&mut target, &layout);
    let gradient = (&target[..], &layout);
    context.weight_gradient(conv, &shape, source.view(), gradient, gradients);
    let to = source.grid.bare();
    let known = of_maps.remove(&conv.input);
    let accumulate = known.is_some();
    let mut sum = known.unwrap_or_else(|| context.recycler.take(to.len()));
    transpose.apply(gradient, (&mut sum, &to), accumulate);
    of_maps.insert(conv.input, sum);
    Ok(())
}
