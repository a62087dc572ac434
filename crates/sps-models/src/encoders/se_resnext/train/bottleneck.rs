//! One bottleneck, forward and backward.

use std::sync::Arc;

use super::Link;
use super::gate::KeptGate;
use super::layer::{Context, Gradients};
use crate::encoders::plain::BatchStatistics;
use crate::encoders::se_resnext::Bottleneck;
use crate::error::Result;
use crate::ops::batch_norm::{FrameSums, Norm, NormGradients};
use crate::ops::buffer::Scratch;
use crate::ops::grid::{Grid, pixels};
use crate::ops::residual::{Branch, FrameSlopes, Shortcut};
use crate::ops::statistics::ChannelStatistics;

/// A convolution's output and the norm of it.
#[derive(Debug)]
struct Normed {
    conv: Scratch,
    norm: Norm,
    moments: ChannelStatistics,
    grid: Grid,
}

/// What the backward pass needs beside input and output.
#[derive(Debug)]
pub(super) struct Kept {
    reduced: Normed,
    /// The first convolution's rectified norm, with the second's padding around it.
    padded: Scratch,
    padded_grid: Grid,
    grouped: Normed,
    /// The second convolution's rectified norm.
    middle: Scratch,
    expanded: Normed,
    gate: KeptGate,
    shortcut: Option<Normed>,
}

impl Kept {
    /// Runs forward; returns what to keep, the output and its layout.
    pub(super) fn record(
        b: &Bottleneck,
        context: &Context,
        input: &[f32],
        from: &Grid,
        mut statistics: Option<&mut Vec<BatchStatistics>>,
    ) -> Result<(Self, Arc<Scratch>, Grid)> {
        let mut normed = |conv: &str, norm: &str, shape, source: (&[f32], &Grid)| {
            let (conv, grid) = context.conv(&b.name(conv), shape, source)?;
            let statistics = statistics.as_deref_mut();
            let (norm, moments) = context.norm(&b.name(norm), &conv, &grid, statistics)?;
            Ok::<_, crate::Error>(Normed {
                conv,
                norm,
                moments,
                grid,
            })
        };
        let level = context.level;
        let reduced = normed("conv1", "bn1", b.reduce(), (input, from))?;
        let padded_grid = reduced.grid.padded(&b.grouped().window);
        let mut padded = context.recycler.take(padded_grid.len());
        padded_grid.clear_border(&mut padded);
        let target = (&mut padded[..], &padded_grid);
        reduced.norm.apply(level, &reduced.conv, target, true);

        let grouped = normed("conv2", "bn2", b.grouped(), (&padded, &padded_grid))?;
        let mut middle = context.recycler.take(grouped.grid.len());
        let target = (&mut middle[..], &grouped.grid);
        grouped.norm.apply(level, &grouped.conv, target, true);

        let expanded = normed("conv3", "bn3", b.expand(), (&middle, &grouped.grid))?;
        let gate = KeptGate::record(b, context, expanded.squeeze())?;
        let shortcut = if b.downsample {
            let shape = b.shortcut();
            Some(normed(
                "downsample.0",
                "downsample.1",
                shape,
                (input, from),
            )?)
        } else {
            None
        };
        let mut output = context.recycler.take(expanded.grid.len());
        let branch = expanded.branch(&gate.factors);
        let added = match &shortcut {
            Some(normed) => Shortcut::Normed(&normed.conv, &normed.norm),
            None => Shortcut::Plain(input),
        };
        branch.end(level, added, &mut output);
        let to = expanded.grid;
        let kept = Self {
            reduced,
            padded,
            padded_grid,
            grouped,
            middle,
            expanded,
            gate,
            shortcut,
        };
        Ok((kept, Arc::new(output), to))
    }

    /// The gradient of the input, from that of the output.
    pub(super) fn backward(
        &self,
        b: &Bottleneck,
        context: &Context,
        link: &Link,
        output: &[f32],
        mut gradient: Scratch,
        gradients: &mut Gradients,
    ) -> Result<Scratch> {
        let branch = self.expanded.branch(&self.gate.factors);
        let sums = branch.mask(context.level, output, &mut gradient);
        let expanded = self.expanded_gradient(b, context, &branch, &sums, &gradient, gradients)?;
        let grid = &self.expanded.grid;
        let (middle, middle_grid) = ((&self.middle[..], &self.grouped.grid), &self.grouped.grid);
        let shape = b.expand();
        context.weight_gradient(
            &b.name("conv3"),
            &shape,
            middle,
            (&expanded, grid),
            gradients,
        );
        let mut middle = context.recycler.take(middle_grid.len());
        let transpose = context.transpose(&b.name("conv3"), shape)?;
        transpose.apply((&expanded, grid), (&mut middle, middle_grid), false);
        drop(expanded);

        let shape = b.grouped();
        let transpose = context.transpose(&b.name("conv2"), shape)?;
        let reduced_grid = &self.reduced.grid;
        let layout = transpose.layout(reduced_grid.frames, reduced_grid.size, middle_grid.size);
        let layout = layout.staggered();
        let grouped = self
            .grouped
            .backward(context, &b.name("bn2"), &middle, &layout, gradients);
        drop(middle);
        let (padded, grouped) = (
            (&self.padded[..], &self.padded_grid),
            (&grouped[..], &layout),
        );
        context.weight_gradient(&b.name("conv2"), &shape, padded, grouped, gradients);
        let mut inner = context.recycler.take(reduced_grid.len());
        transpose.apply(grouped, (&mut inner, reduced_grid), false);

        let reduced =
            self.reduced
                .backward(context, &b.name("bn1"), &inner, reduced_grid, gradients);
        drop(inner);
        self.input_gradient(b, context, link, &reduced, gradient, gradients)
    }

    /// Through the gate and the last norm: the gradient of the last convolution.
    fn expanded_gradient(
        &self,
        b: &Bottleneck,
        context: &Context,
        branch: &Branch<'_>,
        sums: &FrameSums,
        gradient: &[f32],
        gradients: &mut Gradients,
    ) -> Result<Scratch> {
        let Normed {
            norm,
            moments,
            grid,
            ..
        } = &self.expanded;
        let channels = grid.channels;
        let count = pixels(grid.size) as f64;
        let wide = |values: &[f32], i: usize| f64::from(values[i % values.len()]);
        let pairs = sums.gradient.iter().zip(&sums.product).enumerate();
        let factors: Vec<f32> = pairs
            .map(|(i, (g, p))| (wide(&norm.factor, i) * p + wide(&norm.beta, i) * g) as f32)
            .collect();
        let means = self.gate.backward(b, context, &factors, gradients)?;
        // Each pixel's gradient behind the norm is its own times the gate, and its share of the
        // mean's.
        let mut behind = FrameSums {
            gradient: Vec::with_capacity(means.len()),
            product: Vec::with_capacity(means.len()),
        };
        for (i, mean) in means.iter().enumerate() {
            let (gate, mean) = (f64::from(self.gate.factors[i]), f64::from(*mean));
            let offset = f64::from(moments.frame_means[i]) - wide(&norm.mean, i);
            behind.gradient.push(gate * sums.gradient[i] + mean);
            behind.product.push(gate * sums.product[i] + mean * offset);
        }
        let normed = NormGradients::new(norm, moments.count, &behind.over_frames(channels));
        let factor = |i: usize| norm.factor[i % channels];
        let gates = self.gate.factors.iter().enumerate();
        let slopes = FrameSlopes {
            of_gradient: gates.map(|(i, gate)| factor(i) * gate).collect(),
            of_x: normed.slopes.of_x.clone(),
            constant: means
                .iter()
                .enumerate()
                .map(|(i, mean)| {
                    let share = (f64::from(*mean) / count) as f32;
                    factor(i) * share + normed.slopes.constant[i % channels]
                })
                .collect(),
        };
        gradients.norm(&b.name("bn3"), normed);
        let mut target = context.recycler.take(grid.len());
        branch.backward(context.level, &slopes, gradient, &mut target);
        Ok(target)
    }

    /// Adds up what reaches the input over the first convolution and over the shortcut.
    fn input_gradient(
        &self,
        b: &Bottleneck,
        context: &Context,
        link: &Link,
        reduced: &[f32],
        gradient: Scratch,
        gradients: &mut Gradients,
    ) -> Result<Scratch> {
        let (input, from) = ((&link.input[..], &link.from), &link.from);
        let reduced = (reduced, &self.reduced.grid);
        let (conv1, shape) = (b.name("conv1"), b.reduce());
        context.weight_gradient(&conv1, &shape, input, reduced, gradients);
        let transpose = context.transpose(&conv1, shape)?;
        let Some(shortcut) = &self.shortcut else {
            let mut sum = gradient;
            transpose.apply(reduced, (&mut sum, from), true);
            return Ok(sum);
        };
        let mut sum = context.recycler.take(from.len());
        transpose.apply(reduced, (&mut sum, from), false);
        let norm = b.name("downsample.1");
        let level = context.level;
        let sums = shortcut
            .norm
            .sums(level, &shortcut.conv, &gradient, &shortcut.grid, false);
        let sums = sums.over_frames(shortcut.grid.channels);
        let normed = NormGradients::new(&shortcut.norm, shortcut.moments.count, &sums);
        let mut conv = context.recycler.take(shortcut.grid.len());
        let target = (&mut conv[..], &shortcut.grid);
        shortcut.norm.backward(
            level,
            &normed.slopes,
            &shortcut.conv,
            &gradient,
            target,
            false,
        );
        gradients.norm(&norm, normed);
        let (layer, shape) = (b.name("downsample.0"), b.shortcut());
        let conv = (&conv[..], &shortcut.grid);
        context.weight_gradient(&layer, &shape, input, conv, gradients);
        context
            .transpose(&layer, shape)?
            .apply(conv, (&mut sum, from), true);
        Ok(sum)
    }
}

impl Normed {
    /// The mean over space of the norm, `(frames, channels)`: the norm of the mean.
    fn squeeze(&self) -> Vec<f32> {
        let Norm {
            mean, factor, beta, ..
        } = &self.norm;
        let norm = |(i, x): (usize, &f32)| {
            let c = i % mean.len();
            (x - mean[c]) * factor[c] + beta[c]
        };
        self.moments
            .frame_means
            .iter()
            .enumerate()
            .map(norm)
            .collect()
    }

    fn branch<'a>(&'a self, gate: &'a [f32]) -> Branch<'a> {
        Branch {
            x: &self.conv,
            norm: &self.norm,
            gate,
            grid: &self.grid,
        }
    }

    /// The convolution's gradient, laid out as `layout`, from that of the rectified norm.
    fn backward(
        &self,
        context: &Context,
        layer: &str,
        gradient: &[f32],
        layout: &Grid,
        gradients: &mut Gradients,
    ) -> Scratch {
        let level = context.level;
        let sums = self
            .norm
            .sums(level, &self.conv, gradient, &self.grid, true);
        let sums = sums.over_frames(self.grid.channels);
        let normed = NormGradients::new(&self.norm, self.moments.count, &sums);
        let mut target = context.recycler.take(layout.len());
        layout.clear_border(&mut target);
        let slopes = &normed.slopes;
        self.norm.backward(
            level,
            slopes,
            &self.conv,
            gradient,
            (&mut target, layout),
            true,
        );
        gradients.norm(layer, normed);
        target
    }
}
