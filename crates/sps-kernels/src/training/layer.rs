//! What the parts of the tape share: parameters, memory, gradients.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::error::{Result, too_small};
use crate::network::{self, IMAGE, Layer, Map, Network};
use crate::ops::bands::Threads;
use crate::ops::batch_norm::{Norm, NormGradients};
use crate::ops::buffer::{Recycler, Scratch};
use crate::ops::conv::{Conv, ConvShape};
use crate::ops::conv_weight::{weight_gradient, weight_gradient_of_images};
use crate::ops::grid::{Grid, pixels};
use crate::ops::product::{Activation, Epilogue};
use crate::ops::simd::Level;
use crate::ops::statistics::ChannelStatistics;
use crate::ops::words::Real;
use crate::tensors::{Tensors, with_values};
use crate::training::BatchStatistics;

/// What a pass works with.
#[derive(Debug)]
pub(super) struct Context {
    pub(super) network: Arc<Network>,
    pub(super) tensors: Arc<dyn Tensors>,
    pub(super) recycler: Arc<Recycler>,
    pub(super) level: Level,
    /// Whether batch norm goes by them.
    pub(super) running_statistics: bool,
}

/// Gradients by the parameters' names.
#[derive(Debug, Clone, Default)]
pub struct Gradients(pub BTreeMap<String, Vec<f32>>);

impl Gradients {
    /// Adds those of another pass.
    pub fn add(&mut self, other: Self) {
        for (name, values) in other.0 {
            let Some(sums) = self.0.get_mut(&name) else {
                self.0.insert(name, values);
                continue;
            };
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += value;
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

/// A backward pass through a segment.
pub(super) struct Reverse<'a, W: Real> {
    pub(super) context: &'a Context,
    /// The gradients of maps, without borders, as far as they are known.
    pub(super) of_maps: BTreeMap<Map, Scratch<W>>,
    /// Those of the parameters.
    pub(super) gradients: &'a mut Gradients,
}

impl Context {
    /// Calls `work` with a parameter's numbers.
    pub(super) fn parameter<T>(&self, name: &str, work: impl FnOnce(&[f32]) -> T) -> Result<T> {
        with_values(self.tensors.as_ref(), name, work)
    }

    /// Whether a map is a norm that only residual branches are added to: they take the norm, and it is never written.
    pub(super) fn deferred(&self, map: Map) -> bool {
        let layers = &self.network.layers;
        let mut readers = layers
            .iter()
            .filter(|layer| layer.inputs().any(|m| m == map));
        let makes = map.checked_sub(1).and_then(|number| layers.get(number));
        matches!(makes, Some(Layer::Conv(conv)) if conv.activation == Activation::Identity && conv.norm.is_some())
            && self.network.block(map).is_none()
            && readers.all(|layer| layer.shortcut() == Some(map))
    }

    /// Convolves by `{layer}.weight`.
    pub(super) fn convolve<W: Real>(
        &self,
        conv: &network::Conv,
        source: (&[W], &Grid),
        target: (&mut [W], &Grid),
        epilogue: Epilogue<'_>,
    ) -> Result<()> {
        let shape = conv.shape(source.1.size);
        let packed = self.parameter(&format!("{}.weight", conv.name), |weights| {
            let pack = match conv.input {
                IMAGE => Conv::pack_for_images,
                _ => Conv::pack,
            };
            pack(self.level, shape, weights)
        })?;
        packed.apply(Threads::All, source, target, epilogue);
        Ok(())
    }

    /// The batch norm of a feature map, and the map's means over space, `(frames, channels)`: empty by running statistics,
    /// unless the map is `squeezed`. The batch's statistics are noted where asked for.
    pub(super) fn norm<W: Real>(
        &self,
        layer: &str,
        (source, grid): (&[W], &Grid),
        squeezed: bool,
        statistics: Option<&mut Vec<BatchStatistics>>,
    ) -> Result<(Norm, Vec<f32>)> {
        let parameter = |leaf| self.parameter(&format!("{layer}.{leaf}"), <[f32]>::to_vec);
        let (gamma, beta, eps) = (parameter("weight")?, parameter("bias")?, self.network.eps);
        let moments = || ChannelStatistics::of(self.level, source, grid);
        if self.running_statistics {
            let (mean, variance) = (parameter("running_mean")?, parameter("running_var")?);
            let norm = Norm::given([&mean, &variance, &gamma, &beta], eps);
            let means = squeezed.then(|| moments().frame_means);
            return Ok((norm, means.unwrap_or_default()));
        }
        let moments = moments();
        BatchStatistics::check_count(moments.count, layer)?;
        let norm = Norm::new(&moments, &gamma, &beta, eps);
        if let Some(statistics) = statistics {
            statistics.push(BatchStatistics {
                layer: layer.to_owned(),
                mean: moments.mean,
                variance: moments.variance,
                count: moments.count,
            });
        }
        Ok((norm, moments.frame_means))
    }

    /// Notes the gradient of a convolution's weights.
    pub(super) fn weight_gradient<W: Real>(
        &self,
        conv: &network::Conv,
        shape: &ConvShape,
        source: (&[W], &Grid),
        gradient: (&[W], &Grid),
        gradients: &mut Gradients,
    ) {
        let taps = pixels(shape.window.size);
        let mut values = vec![0.0; shape.outputs * shape.group_inputs() * taps];
        let write = match conv.input {
            IMAGE => weight_gradient_of_images,
            _ => weight_gradient,
        };
        write(self.level, shape, source, gradient, &mut values);
        gradients.insert(&conv.name, "weight", values);
    }
}

/// The layout of what a convolution makes of a map, by itself.
pub(super) fn output<W: Real>(conv: &network::Conv, from: &Grid) -> Result<Grid> {
    let size = conv.shape(from.size).window.output(from.size);
    let size = size.ok_or_else(|| too_small(from.size))?;
    let to = Grid::tight(from.frames, size, conv.outputs).of::<W>();
    Ok(to.staggered())
}
