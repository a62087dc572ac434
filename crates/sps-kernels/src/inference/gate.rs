//! The squeeze-and-excitation gate in inference.

use super::folded::{Folded, Packed};
use super::scales::Scale;
use crate::error::Result;
use crate::network::Gate;
use crate::ops::bands::Threads;
use crate::ops::conv::ConvShape;
use crate::ops::grid::{Grid, Window};
use crate::ops::mean::frame_means;
use crate::ops::panels::Panels;
use crate::ops::product::{Activation, Epilogue, product_of_rows};
use crate::ops::simd::Level;
use crate::ops::words::Word;
use crate::tensors::Tensors;

/// From the mean of a 1x1 convolution's input to a factor of each of its outputs.
#[derive(Debug)]
pub(super) struct PackedGate {
    /// The matrix of each layer, and what it adds.
    hidden: (Panels, Vec<f32>),
    logits: (Panels, Vec<f32>),
}

impl PackedGate {
    /// Of the outputs of `conv`.
    pub(super) fn new(
        gate: &Gate,
        conv: &Folded,
        weights: &dyn Tensors,
        level: Level,
    ) -> Result<Self> {
        let linear = |layer: &str, inputs, outputs| {
            let shape = ConvShape {
                window: Window::square(1, 1, 0),
                inputs,
                outputs,
                groups: 1,
            };
            Folded::bias(shape, weights, layer)
        };
        let [hidden, logits] = &gate.layers;
        let hidden = linear(hidden, gate.channels, gate.hidden)?;
        let logits = linear(logits, gate.hidden, gate.channels)?;
        Ok(Self {
            hidden: hidden.compose(conv, level).pack_linear(level),
            logits: logits.pack_linear(level),
        })
    }

    /// What the outputs of `conv`, a convolution of a map of such a scale, are multiplied with and what
    /// is added then, each `(frames, channels)`; its own factors and shifts are part of that.
    pub(super) fn factors<W: Word>(
        &self,
        threads: Threads,
        level: Level,
        (source, from, of): (&[W], &Grid, Scale),
        conv: &Packed<W>,
    ) -> [Vec<f32>; 2] {
        let mut means = vec![0.0; from.frames * from.channels];
        let mut rows_of: Vec<_> = means.chunks_exact_mut(from.channels).collect();
        frame_means(threads, level, source, from, &mut rows_of);
        for mean in &mut means {
            *mean = of.value(*mean);
        }
        let (panels, shift) = &self.hidden;
        let hidden = product_of_rows(&means, panels, Epilogue::biased(shift, Activation::Relu));
        let (panels, shift) = &self.logits;
        let identity = Epilogue::biased(shift, Activation::Identity);
        let mut scale = product_of_rows(&hidden, panels, identity);
        for logit in &mut scale {
            *logit = 1.0 / (1.0 + (-*logit).exp());
        }
        let mut shift = scale.clone();
        let channels = conv.shift.len();
        for frame in shift.chunks_exact_mut(channels) {
            for (shift, bias) in frame.iter_mut().zip(&conv.shift) {
                *shift = *shift * bias + conv.offset;
            }
        }
        if let Some(factors) = &conv.scale {
            for frame in scale.chunks_exact_mut(channels) {
                for (scale, factor) in frame.iter_mut().zip(factors) {
                    *scale *= factor;
                }
            }
        }
        [scale, shift]
    }
}
