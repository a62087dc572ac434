//! A convolution and its norm, forward and backward.

use super::layer::{Context, Gradients};
use super::{Value, segment::MapGradients};
use crate::encoders::network::{Conv, IMAGE};
use crate::encoders::plain::BatchStatistics;
use crate::error::Result;
use crate::ops::batch_norm::{Norm, NormGradients, Slopes};
use crate::ops::buffer::Scratch;
use crate::ops::grid::Grid;
use crate::ops::product::Activation;
use crate::ops::statistics::ChannelStatistics;
use crate::ops::words::Real;

/// A convolution's output and the norm of it. A bias is a norm that has no statistics.
#[derive(Debug)]
pub(super) struct KeptConv<W: Real> {
    pub(super) raw: Scratch<W>,
    pub(super) grid: Grid,
    pub(super) norm: Norm,
    pub(super) moments: Option<ChannelStatistics>,
}

impl<W: Real> KeptConv<W> {
    /// Runs forward up to the norm.
    pub(super) fn record(
        context: &Context,
        conv: &Conv,
        source: &Value<W>,
        statistics: Option<&mut Vec<BatchStatistics>>,
    ) -> Result<Self> {
        let (raw, grid) = context.conv(conv, source.view())?;
        let (norm, moments) = if let Some(name) = &conv.norm {
            let (norm, moments) = context.norm(name, (&raw[..], &grid), statistics)?;
            (norm, Some(moments))
        } else {
            let bias = context.parameter(&format!("{}.bias", conv.name), <[f32]>::to_vec)?;
            (Norm::bias(bias), None)
        };
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
        let means = self.moments.iter().flat_map(|moments| &moments.frame_means);
        let norm = |(i, x): (usize, &f32)| {
            let c = i % mean.len();
            (x - mean[c]) * factor[c] + beta[c]
        };
        means.enumerate().map(norm).collect()
    }

    /// Writes the activated norm into channels of a map, which the target begins with.
    pub(super) fn activate(
        &self,
        context: &Context,
        activation: Activation,
        target: (&mut [W], &Grid),
    ) {
        let raw = (&self.raw[..], &self.grid);
        self.norm.apply(context.level, raw, target, activation);
    }

    /// Runs backward, from the gradient of the activated norm, which lies as the output.
    pub(super) fn backward(
        &self,
        (context, conv): (&Context, &Conv),
        source: &Value<W>,
        gradient: &[W],
        of_maps: &mut MapGradients<W>,
        gradients: &mut Gradients,
    ) -> Result<()> {
        let (level, activation) = (context.level, conv.activation);
        let sums = self
            .norm
            .sums(level, &self.raw, gradient, &self.grid, activation);
        let sums = sums.over_frames(self.grid.channels);
        let slopes = self.slopes(conv, &sums, gradients);
        self.input_gradient(
            context,
            conv,
            source,
            of_maps,
            gradients,
            |target, layout| {
                let target = (target, layout);
                self.norm
                    .backward(level, &slopes, &self.raw, gradient, target, activation);
            },
        )
    }

    /// What gives the gradient of the output; notes those of the norm or of the bias.
    fn slopes(&self, conv: &Conv, sums: &[Vec<f64>; 2], gradients: &mut Gradients) -> Slopes {
        if let (Some(name), Some(moments)) = (&conv.norm, &self.moments) {
            let of_norm = NormGradients::new(&self.norm, moments.count, sums);
            let slopes = of_norm.slopes.clone();
            gradients.norm(name, of_norm);
            return slopes;
        }
        let bias = sums[0].iter().map(|&sum| sum as f32).collect();
        gradients.insert(&conv.name, "bias", bias);
        Slopes::identity(self.grid.channels)
    }

    /// Notes the gradient of the weights, and adds that of the input, from that of the output, which
    /// `write` writes into memory of such a layout.
    pub(super) fn input_gradient(
        &self,
        context: &Context,
        conv: &Conv,
        source: &Value<W>,
        of_maps: &mut MapGradients<W>,
        gradients: &mut Gradients,
        write: impl FnOnce(&mut [W], &Grid),
    ) -> Result<()> {
        let shape = conv.shape(source.grid.size);
        if conv.input == IMAGE {
            let mut target = context.recycler.take(self.grid.len());
            write(&mut target, &self.grid);
            let gradient = (&target[..], &self.grid);
            context.weight_gradient(conv, &shape, source.view(), gradient, gradients);
            return Ok(());
        }
        let transpose = context.transpose::<W>(&conv.name, shape)?;
        let layout = transpose.layout(self.grid.frames, source.grid.size, self.grid.size);
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
}
