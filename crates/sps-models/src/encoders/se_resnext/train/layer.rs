//! What the parts of the tape share: parameters, memory, gradients.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use crate::encoders::plain::{BatchStatistics, check_count};
use crate::error::{Error, Result};
use crate::ops::bands::Threads;
use crate::ops::batch_norm::{Norm, NormGradients};
use crate::ops::buffer::{Recycler, Scratch};
use crate::ops::conv::{Conv, ConvShape};
use crate::ops::conv_input::ConvTranspose;
use crate::ops::conv_weight::weight_gradient;
use crate::ops::grid::Grid;
use crate::ops::product::Epilogue;
use crate::ops::simd::Level;
use crate::ops::statistics::ChannelStatistics;
use crate::ops::with_values;
use crate::weights::Weights;

/// What batch norm adds to a variance.
const BATCH_NORM_EPS: f64 = 1e-5;

/// What a pass works with.
#[derive(Debug)]
pub(in crate::encoders) struct Context {
    pub(in crate::encoders) weights: Weights,
    pub(in crate::encoders) recycler: Arc<Recycler>,
    pub(in crate::encoders) level: Level,
}

/// Gradients by the parameters' names.
#[derive(Debug, Clone, Default)]
pub(in crate::encoders) struct Gradients(pub(in crate::encoders) BTreeMap<String, Vec<f32>>);

impl Gradients {
    /// Adds those of another pass.
    pub(in crate::encoders) fn add(&mut self, other: Self) {
        for (name, values) in other.0 {
            match self.0.entry(name) {
                Entry::Vacant(entry) => {
                    entry.insert(values);
                }
                Entry::Occupied(mut entry) => {
                    for (sum, value) in entry.get_mut().iter_mut().zip(values) {
                        *sum += value;
                    }
                }
            }
        }
    }

    pub(super) fn insert(&mut self, layer: &str, leaf: &str, values: Vec<f32>) {
        self.0.insert(format!("{layer}.{leaf}"), values);
    }

    /// Those of a batch norm's own parameters.
    pub(super) fn norm(&mut self, layer: &str, gradients: NormGradients) {
        self.insert(layer, "weight", gradients.gamma);
        self.insert(layer, "bias", gradients.beta);
    }
}

impl Context {
    /// Calls `work` with a parameter's numbers.
    pub(super) fn parameter<T>(&self, name: &str, work: impl FnOnce(&[f32]) -> T) -> Result<T> {
        let tensor = self.weights.get(name)?;
        Ok(with_values(tensor, |values| Ok(work(values)))?)
    }

    /// Convolves by `{layer}.weight`.
    pub(super) fn conv(
        &self,
        layer: &str,
        shape: ConvShape,
        (source, from): (&[f32], &Grid),
    ) -> Result<(Scratch, Grid)> {
        let conv = self.parameter(&format!("{layer}.weight"), |weights| {
            Conv::pack(self.level, shape, weights)
        })?;
        let Some(size) = shape.window.output(from.size) else {
            return Err(Error::input(
                "images",
                format_args!("{:?}", from.size),
                "larger ones",
            ));
        };
        let to = Grid::tight(from.frames, size, shape.outputs).staggered();
        let mut target = self.recycler.take(to.len());
        let epilogue = Epilogue::default();
        conv.apply(Threads::All, (source, from), (&mut target, &to), epilogue);
        Ok((target, to))
    }

    /// Batch norm's statistics of a feature map; noted where asked for.
    pub(super) fn norm(
        &self,
        layer: &str,
        source: &[f32],
        grid: &Grid,
        statistics: Option<&mut Vec<BatchStatistics>>,
    ) -> Result<(Norm, ChannelStatistics)> {
        let moments = ChannelStatistics::of(self.level, source, grid);
        check_count(moments.count, layer)?;
        let gamma = self.parameter(&format!("{layer}.weight"), <[f32]>::to_vec)?;
        let norm = self.parameter(&format!("{layer}.bias"), |beta| {
            Norm::new(&moments, &gamma, beta, BATCH_NORM_EPS)
        })?;
        if let Some(statistics) = statistics {
            statistics.push(BatchStatistics {
                layer: layer.to_owned(),
                mean: moments.mean.clone(),
                variance: moments.variance.clone(),
                count: moments.count,
            });
        }
        Ok((norm, moments))
    }

    /// Notes the gradient of `{layer}.weight`.
    pub(super) fn weight_gradient(
        &self,
        layer: &str,
        shape: &ConvShape,
        source: (&[f32], &Grid),
        gradient: (&[f32], &Grid),
        gradients: &mut Gradients,
    ) {
        let taps: usize = shape.window.size.iter().product();
        let mut values = vec![0.0; shape.outputs * shape.group_inputs() * taps];
        weight_gradient(self.level, shape, source, gradient, &mut values);
        gradients.insert(layer, "weight", values);
    }

    /// The transpose of the convolution by `{layer}.weight`.
    pub(super) fn transpose(&self, layer: &str, shape: ConvShape) -> Result<ConvTranspose> {
        self.parameter(&format!("{layer}.weight"), |weights| {
            ConvTranspose::pack(self.level, shape, weights)
        })
    }
}
