//! The squeeze-and-excitation gate, forward and backward.

use super::layer::{Context, Gradients};
use crate::error::Result;
use crate::network::Gate;
use crate::ops::grid::starts;
use crate::ops::outer::Outer;
use crate::ops::panels::Panels;
use crate::ops::product::{Activation, Epilogue, product_of_rows};

/// What the gate's backward pass needs; all `(frames, channels)`.
#[derive(Debug)]
pub(super) struct KeptGate {
    squeezed: Vec<f32>,
    /// The hidden layer, rectified.
    hidden: Vec<f32>,
    /// The gate: factors in (0, 1).
    pub(super) factors: Vec<f32>,
}

impl KeptGate {
    /// From the branch's means over space.
    pub(super) fn record(gate: &Gate, context: &Context, squeezed: Vec<f32>) -> Result<Self> {
        let [fc1, fc2] = &gate.layers;
        let hidden = linear(context, fc1, &squeezed, gate.channels, Activation::Relu)?;
        let mut factors = linear(context, fc2, &hidden, gate.hidden, Activation::Identity)?;
        for logit in &mut factors {
            *logit = 1.0 / (1.0 + (-*logit).exp());
        }
        Ok(Self {
            squeezed,
            hidden,
            factors,
        })
    }

    /// The gradient of the branch's means, from that of the factors.
    pub(super) fn backward(
        &self,
        gate: &Gate,
        context: &Context,
        factors: &[f32],
        gradients: &mut Gradients,
    ) -> Result<Vec<f32>> {
        let logits = factors.iter().zip(&self.factors);
        let logits: Vec<f32> = logits.map(|(g, s)| g * s * (1.0 - s)).collect();
        let [fc1, fc2] = &gate.layers;
        let (wide, narrow) = (gate.channels, gate.hidden);
        let mut hidden = linear_backward(context, fc2, &self.hidden, &logits, wide, gradients)?;
        for (gradient, hidden) in hidden.iter_mut().zip(&self.hidden) {
            *gradient = if *hidden > 0.0 { *gradient } else { 0.0 };
        }
        linear_backward(context, fc1, &self.squeezed, &hidden, narrow, gradients)
    }
}

/// `x W^T + b` for rows of `inputs`, by `{layer}.weight` `(outputs, inputs)`.
fn linear(
    context: &Context,
    layer: &str,
    x: &[f32],
    inputs: usize,
    activation: Activation,
) -> Result<Vec<f32>> {
    let level = context.level;
    context.parameter(&format!("{layer}.bias"), |bias| {
        context.parameter(&format!("{layer}.weight"), |weight| {
            let panels = Panels::pack_transposed(level, inputs, bias.len(), weight);
            product_of_rows(x, &panels, Epilogue::biased(bias, activation))
        })
    })?
}

/// The gradient of `x`, from that of the output, rows of `outputs`.
fn linear_backward(
    context: &Context,
    layer: &str,
    x: &[f32],
    gradient: &[f32],
    outputs: usize,
    gradients: &mut Gradients,
) -> Result<Vec<f32>> {
    let frames = gradient.len() / outputs;
    let inputs = x.len() / frames;
    let mut weight = vec![0.0; outputs * inputs];
    let outer = Outer {
        left: (gradient, &starts(frames, outputs)),
        right: (x, &starts(frames, inputs)),
        height: outputs,
        width: inputs,
    };
    outer.add(context.level, &mut weight, inputs);
    gradients.insert(layer, "weight", weight);
    let mut bias = vec![0.0; outputs];
    for row in gradient.chunks_exact(outputs) {
        for (bias, gradient) in bias.iter_mut().zip(row) {
            *bias += gradient;
        }
    }
    gradients.insert(layer, "bias", bias);
    context.parameter(&format!("{layer}.weight"), |weight| {
        let panels = Panels::pack_rows(context.level, outputs, inputs, weight);
        product_of_rows(gradient, &panels, Epilogue::default())
    })
}
