//! The squeeze-and-excitation gate in inference.

use super::folded::{Ends, Folded, Packed};
use super::scales::Scale;
use crate::error::Result;
use crate::network::Gate;
use crate::ops::bands::Threads;
use crate::ops::conv::ConvShape;
use crate::ops::grid::{Grid, Window};
use crate::ops::mean::frame_means;
use crate::ops::product::{Activation, Columns, Epilogue};
use crate::ops::simd::Level;
use crate::ops::words::Word;
use crate::tensors::Tensors;

/// From the mean of a 1x1 convolution's input to a factor of each of its outputs.
#[derive(Debug)]
pub(super) struct PackedGate {
    hidden: Packed,
    logits: Packed,
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
            hidden: hidden.compose(conv, level).pack((level, false), Ends::UNIT),
            logits: logits.pack((level, false), Ends::UNIT),
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
        let hidden = rows(&self.hidden, from.frames, &means, Activation::Relu);
        let mut scale = rows(&self.logits, from.frames, &hidden, Activation::Identity);
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

/// A layer of vectors, one of each frame.
fn rows(layer: &Packed, frames: usize, source: &[f32], activation: Activation) -> Vec<f32> {
    let ConvShape {
        inputs, outputs, ..
    } = *layer.conv.shape();
    let vectors = |channels| Grid::tight(frames, [1; 3], channels);
    let mut target = vec![0.0; frames * outputs];
    let epilogue = Epilogue {
        shift: Some(Columns::shared(&layer.shift)),
        limits: activation.limits(),
        ..Epilogue::default()
    };
    let (from, to) = (vectors(inputs), vectors(outputs));
    let target_of = (&mut target[..], &to);
    layer
        .conv
        .apply(Threads::One, (source, &from), target_of, epilogue);
    target
}
