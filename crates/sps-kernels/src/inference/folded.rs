//! Convolutions as inference needs them: what follows them linearly is part of them.

use super::scales::Scale;
use crate::error::Result;
use crate::network::{self, IMAGE};
use crate::ops::conv::{Conv, ConvShape};
use crate::ops::panels::Panels;
use crate::ops::product::{Activation, Epilogue, product_of_rows};
use crate::ops::simd::Level;
use crate::ops::words::{Bytes, Word};
use crate::tensors::{Tensors, with_values};

/// The weights of a convolution and what it adds to each channel.
#[derive(Debug)]
pub(super) struct Folded {
    shape: ConvShape,
    /// `(outputs, inputs / groups, time, height, width)`
    weights: Vec<f32>,
    shift: Vec<f32>,
    /// Whether it is one of images.
    of_images: bool,
}

impl Folded {
    /// A convolution with its bias or with the batch norm after it, which becomes part of it.
    pub(super) fn new(conv: &network::Conv, weights: &dyn Tensors, eps: f64) -> Result<Self> {
        let shape = conv.shape([1; 3]);
        let of_images = conv.input == IMAGE;
        let Some(norm) = &conv.norm else {
            let bias = Self::bias(shape, weights, &conv.name)?;
            return Ok(Self { of_images, ..bias });
        };
        let read = |leaf: &str| values(weights, &format!("{norm}.{leaf}"));
        let (gamma, beta) = (read("weight")?, read("bias")?);
        let (mean, variance) = (read("running_mean")?, read("running_var")?);
        let mut folded = values(weights, &format!("{}.weight", conv.name))?;
        let mut shift = Vec::with_capacity(shape.outputs);
        let per_output = folded.len() / shape.outputs;
        for (channel, weights) in folded.chunks_exact_mut(per_output).enumerate() {
            let at = |values: &[f32]| f64::from(values[channel]);
            let scale = at(&gamma) / (at(&variance) + eps).sqrt();
            for weight in weights {
                *weight = (f64::from(*weight) * scale) as f32;
            }
            shift.push((at(&beta) - at(&mean) * scale) as f32);
        }
        Ok(Self {
            shape,
            weights: folded,
            shift,
            of_images,
        })
    }

    /// A convolution with a bias.
    pub(super) fn bias(shape: ConvShape, weights: &dyn Tensors, layer: &str) -> Result<Self> {
        Ok(Self {
            shape,
            weights: values(weights, &format!("{layer}.weight"))?,
            shift: values(weights, &format!("{layer}.bias"))?,
            of_images: false,
        })
    }

    /// This 1x1 convolution of what `inner`, another, makes of its input: one convolution again.
    pub(super) fn compose(&self, inner: &Self, level: Level) -> Self {
        let (inputs, middle) = (inner.shape.inputs, self.shape.inputs);
        let product = |n: usize, right: &[f32]| {
            let panels = Panels::pack_rows(level, middle, n, right);
            product_of_rows(&self.weights, &panels, Epilogue::default())
        };
        let weights = product(inputs, &inner.weights);
        let mut shift = product(1, &inner.shift);
        for (shift, own) in shift.iter_mut().zip(&self.shift) {
            *shift += own;
        }
        Self {
            shape: ConvShape {
                inputs,
                ..self.shape
            },
            weights,
            shift,
            of_images: inner.of_images,
        }
    }

    /// Lays this 1x1 convolution out for vectors: a matrix, and what it adds.
    pub(super) fn pack_linear(self, level: Level) -> (Panels, Vec<f32>) {
        let ConvShape {
            inputs, outputs, ..
        } = self.shape;
        let panels = Panels::pack_transposed(level, inputs, outputs, &self.weights);
        (panels, self.shift)
    }

    /// Lays it out for the kernels, for a map of such words and scales.
    pub(super) fn pack<W: Word>(mut self, (level, split): (Level, bool), ends: Ends) -> Packed<W> {
        let (scale, offset) = if W::WHOLE {
            (Some(self.quantise(ends)), ends.offset())
        } else {
            (None, 0.0)
        };
        let pack = match (self.of_images, split) {
            (true, true) => Conv::pack_split_for_images,
            (true, false) => Conv::pack_for_images,
            (false, true) => Conv::pack_split,
            (false, false) => Conv::pack_for_inference,
        };
        Packed {
            conv: pack(level, self.shape, &self.weights),
            scale,
            shift: self.shift,
            offset,
        }
    }

    /// Makes the weights of each output whole numbers of -127 to 127, and the shifts such as they are
    /// added to sums in steps of the target. Returns what the sums are multiplied with before.
    fn quantise(&mut self, Ends { from, to, .. }: Ends) -> Vec<f32> {
        let per_output = self.weights.len() / self.shape.outputs;
        debug_assert!(per_output <= Bytes::LONGEST_SUM, "{:?}", self.shape);
        let outputs = self.weights.chunks_exact_mut(per_output);
        let steps = outputs.zip(&mut self.shift).map(|(weights, shift)| {
            let largest = weights.iter().fold(0.0_f32, |m, w| m.max(w.abs()));
            // Of weights that are all 0, or so small that they make no difference.
            let step = if largest < f32::MIN_POSITIVE * LARGEST {
                1.0
            } else {
                f64::from(largest / LARGEST)
            };
            let mut sum = 0.0;
            for weight in weights {
                *weight = (f64::from(*weight) / step + HALVES_TO_EVEN - HALVES_TO_EVEN) as f32;
                sum += f64::from(*weight);
            }
            let step = step * f64::from(from.step);
            let of_zero = sum * f64::from(from.zero) * step;
            *shift = ((f64::from(*shift) - of_zero) / f64::from(to.step)) as f32;
            (step / f64::from(to.step)) as f32
        });
        steps.collect()
    }
}

/// The largest weight in int8.
const LARGEST: f32 = 127.0;

/// Added and taken away, it rounds small numbers to whole ones, as `round_ties_even` does by a call for each.
const HALVES_TO_EVEN: f64 = 1.5 / f64::EPSILON;

/// The maps around a convolution.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ends {
    pub(super) from: Scale,
    pub(super) to: Scale,
    /// What it is added to.
    pub(super) onto: Option<Scale>,
}

impl Ends {
    /// The factor of the numbers that it is added to.
    pub(super) fn accumulate(&self) -> Option<f32> {
        self.onto.map(|onto| onto.step / self.to.step)
    }

    /// An activation's limits as numbers of the target.
    pub(super) fn limits<W: Word>(&self, activation: Activation) -> [f32; 2] {
        let limits = activation.limits();
        if !W::WHOLE {
            return limits;
        }
        limits.map(|limit| (limit / self.to.step + self.to.zero).clamp(0.0, 255.0))
    }

    /// What is added because 0 is another number on both sides.
    fn offset(&self) -> f32 {
        let onto = self.onto.unwrap_or(Scale::UNIT);
        self.to.zero - onto.step / self.to.step * onto.zero
    }
}

fn values(weights: &dyn Tensors, name: &str) -> Result<Vec<f32>> {
    with_values(weights, name, <[f32]>::to_vec)
}

/// A convolution laid out for the kernels, and what it adds to each channel.
#[derive(Debug)]
pub(super) struct Packed<W> {
    pub(super) conv: Conv<W>,
    /// What the sums of each channel are multiplied with, where they are.
    pub(super) scale: Option<Vec<f32>>,
    pub(super) shift: Vec<f32>,
    /// What is added to all channels, behind a gate.
    pub(super) offset: f32,
}
