//! A convolution and its norm or bias, forward and backward.

use super::Value;
use super::layer::{Context, Reverse, output};
use crate::error::Result;
use crate::network::{Conv, IMAGE};
use crate::ops::activated::activation_gradient;
use crate::ops::batch_norm::{Norm, NormGradients};
use crate::ops::conv_input::ConvTranspose;
use crate::ops::grid::Grid;
use crate::ops::product::Epilogue;
use crate::ops::words::Real;
use crate::training::BatchStatistics;

/// A convolution's output and the norm of it.
#[derive(Debug)]
pub(super) struct KeptConv<W: Real> {
    /// What the norm is of, without a border.
    pub(super) raw: Value<W>,
    pub(super) norm: Norm,
    /// The means of `raw` over space, `(frames, channels)`; may be empty where no gate reads them.
    pub(super) frame_means: Vec<f32>,
}

impl<W: Real> KeptConv<W> {
    /// Runs forward up to the norm.
    pub(super) fn record(
        context: &Context,
        (conv, norm): (&Conv, &str),
        source: &Value<W>,
        squeezed: bool,
        statistics: Option<&mut Vec<BatchStatistics>>,
    ) -> Result<Self> {
        let grid = output::<W>(conv, &source.grid)?;
        let mut memory = context.recycler.take(grid.len());
        let target = (&mut memory[..], &grid);
        context.convolve(conv, source.view(), target, Epilogue::default())?;
        let raw = Value { memory, grid };
        let (norm, frame_means) = context.norm(norm, raw.view(), squeezed, statistics)?;
        Ok(Self {
            raw,
            norm,
            frame_means,
        })
    }

    /// The mean over space of the norm, `(frames, channels)`: the norm of the mean.
    pub(super) fn squeeze(&self) -> Vec<f32> {
        let norm = &self.norm;
        let means = self.frame_means.iter().enumerate();
        let normed = means.map(|(i, x)| {
            let c = i % norm.mean.len();
            (x - norm.mean[c]) * norm.factor[c] + norm.beta[c]
        });
        normed.collect()
    }

    /// Runs backward, from the gradient of the activated norm, which lies as the output.
    pub(super) fn backward(
        &self,
        pass: &mut Reverse<'_, W>,
        (conv, norm): (&Conv, &str),
        source: &Value<W>,
        gradient: &[W],
    ) -> Result<()> {
        let (level, activation) = (pass.context.level, conv.activation);
        let (raw, grid) = self.raw.view();
        let of_this = &self.norm;
        let sums = of_this.sums(level, raw, gradient, grid, activation);
        let sums = sums.over_frames(grid.channels);
        let of_norm = NormGradients::new(of_this, &sums);
        let slopes = of_norm.slopes.clone();
        pass.gradients.norm(norm, of_norm);
        let write = |target: &mut [W], layout: &Grid| {
            let target = (target, layout);
            of_this.backward(level, &slopes, [raw, gradient], target, Some(activation));
        };
        input_gradient(pass, conv, grid, source, write)
    }
}

/// Runs a convolution with a bias backward, from the gradient of its activated output, whose map both begin with its
/// channels.
pub(super) fn biased_backward<W: Real>(
    pass: &mut Reverse<'_, W>,
    conv: &Conv,
    source: &Value<W>,
    activated: (&[W], &Grid),
    gradient: &[W],
) -> Result<()> {
    let level = pass.context.level;
    let grid = output::<W>(conv, &source.grid)?;
    let mut sums = Vec::new();
    let write = |target: &mut [W], layout: &Grid| {
        let target = (target, layout);
        sums = activation_gradient(level, conv.activation, activated, gradient, target);
    };
    input_gradient(pass, conv, &grid, source, write)?;
    let bias = sums.into_iter().map(|sum| sum as f32).collect();
    pass.gradients.insert(&conv.name, "bias", bias);
    Ok(())
}

/// Notes the gradient of the weights, and adds that of the input, from that of the output, which lies as `grid` says
/// and which `write` writes into memory of such a layout.
pub(super) fn input_gradient<W: Real>(
    pass: &mut Reverse<'_, W>,
    conv: &Conv,
    grid: &Grid,
    source: &Value<W>,
    write: impl FnOnce(&mut [W], &Grid),
) -> Result<()> {
    let context = pass.context;
    let shape = conv.shape(source.grid.size);
    if conv.input == IMAGE {
        let mut target = context.recycler.take(grid.len());
        write(&mut target, grid);
        let gradient = (&target[..], grid);
        context.weight_gradient(conv, &shape, source.view(), gradient, pass.gradients);
        return Ok(());
    }
    let transpose = context.parameter(&format!("{}.weight", conv.name), |weights| {
        ConvTranspose::<W>::pack(context.level, shape, weights)
    })?;
    let layout = transpose.layout(grid.frames, source.grid.size, grid.size);
    let layout = layout.staggered();
    let mut target = context.recycler.take(layout.len());
    layout.fill_borders(&mut target, W::default());
    write(&mut target, &layout);
    let gradient = (&target[..], &layout);
    context.weight_gradient(conv, &shape, source.view(), gradient, pass.gradients);
    let to = source.grid.bare();
    let known = pass.of_maps.remove(&conv.input);
    let accumulate = known.is_some();
    let mut sum = known.unwrap_or_else(|| context.recycler.take(to.len()));
    transpose.apply(gradient, (&mut sum, &to), accumulate);
    pass.of_maps.insert(conv.input, sum);
    Ok(())
}
