//! The end of a residual branch, forward and backward.

use super::Value;
use super::conv::{KeptConv, input_gradient};
use super::gate::KeptGate;
use super::layer::{Context, Reverse};
use crate::error::{Error, Result};
use crate::network::{Conv, Gate};
use crate::ops::batch_norm::{FrameSums, NormGradients, Slopes};
use crate::ops::buffer::Scratch;
use crate::ops::grid::{Grid, pixels};
use crate::ops::words::Real;
use crate::training::BatchStatistics;

/// What the backward pass needs beside input and output.
#[derive(Debug)]
pub(super) struct KeptResidual<W: Real> {
    pub(super) conv: KeptConv<W>,
    gate: Option<KeptGate>,
    /// `(frames, channels)`, 1 where there is no gate.
    pub(super) factors: Vec<f32>,
}

impl<W: Real> KeptResidual<W> {
    /// Runs forward up to the gate.
    pub(super) fn record(
        context: &Context,
        conv: &Conv,
        gate: Option<&Gate>,
        source: &Value<W>,
        statistics: Option<&mut Vec<BatchStatistics>>,
    ) -> Result<Self> {
        let Some(norm) = &conv.norm else {
            let expected = "a batch norm before its shortcut";
            return Err(Error::input("network", &conv.name, expected));
        };
        let conv = KeptConv::record(context, (conv, norm), source, gate.is_some(), statistics)?;
        let gate = gate.map(|gate| KeptGate::record(gate, context, conv.squeeze()));
        let gate = gate.transpose()?;
        let factors = match &gate {
            Some(gate) => gate.factors.clone(),
            None => vec![1.0; conv.raw.grid.frames * conv.raw.grid.channels],
        };
        Ok(Self {
            conv,
            gate,
            factors,
        })
    }

    /// Runs backward; returns the gradient of what the branch was added to, which lies as the branch
    /// does.
    pub(super) fn backward(
        &self,
        pass: &mut Reverse<'_, W>,
        (conv, gate): (&Conv, Option<&Gate>),
        [source, end]: [&Value<W>; 2],
        mut gradient: Scratch<W>,
    ) -> Result<Scratch<W>> {
        let (level, activation) = (pass.context.level, conv.activation);
        let (raw, grid) = self.conv.raw.view();
        let norm = &self.conv.norm;
        let sums = norm.mask(level, (raw, grid), end.view(), &mut gradient, activation);
        let slopes = self.slopes(pass, conv, gate, &sums)?;
        let write = |target: &mut [W], layout: &Grid| {
            let ends: [&[W]; 2] = [raw, &gradient];
            norm.backward(level, &slopes, ends, (target, layout), None);
        };
        input_gradient(pass, conv, grid, source, write)?;
        Ok(gradient)
    }

    /// Through the gate and the norm: what gives the gradient of the convolution.
    fn slopes(
        &self,
        pass: &mut Reverse<'_, W>,
        conv: &Conv,
        gate: Option<&Gate>,
        sums: &FrameSums,
    ) -> Result<Slopes> {
        let (norm, grid) = (&self.conv.norm, &self.conv.raw.grid);
        let channels = grid.channels;
        let count = pixels(grid.size) as f64;
        let wide = |values: &[f32], i: usize| f64::from(values[i % values.len()]);
        let means = match (gate, &self.gate) {
            (Some(gate), Some(kept)) => {
                let pairs = sums.gradient.iter().zip(&sums.product).enumerate();
                let factor = |(i, (g, p))| wide(&norm.factor, i) * p + wide(&norm.beta, i) * g;
                let factors: Vec<f32> = pairs.map(|pair| factor(pair) as f32).collect();
                kept.backward(gate, pass.context, &factors, pass.gradients)?
            }
            _ => vec![0.0; self.factors.len()],
        };
        // Each pixel's gradient behind the norm is its own times the gate, and its share of the
        // mean's.
        let behind = means.iter().enumerate().map(|(i, mean)| {
            let (gate, mean) = (f64::from(self.factors[i]), f64::from(*mean));
            // Empty only without a gate, where `mean` is 0.
            let squeezed = self.conv.frame_means.get(i);
            let offset = squeezed.map_or(0.0, |&m| f64::from(m) - wide(&norm.mean, i));
            let product = gate * sums.product[i] + mean * offset;
            (gate * sums.gradient[i] + mean, product)
        });
        let (gradient, product) = behind.unzip();
        let behind = FrameSums { gradient, product };
        let normed = NormGradients::new(norm, &behind.over_frames(channels));
        let factor = |i: usize| norm.factor[i % channels];
        let gates = self.factors.iter().enumerate();
        let shares = means.iter().enumerate().map(|(i, mean)| {
            let share = (f64::from(*mean) / count) as f32;
            factor(i) * share + normed.slopes.constant[i % channels]
        });
        let slopes = Slopes {
            of_gradient: gates.map(|(i, gate)| factor(i) * gate).collect(),
            of_x: normed.slopes.of_x.clone(),
            constant: shares.collect(),
        };
        if let Some(name) = &conv.norm {
            pass.gradients.norm(name, normed);
        }
        Ok(slopes)
    }
}
