//! The scales of feature maps in int8 as a tensor of weights.

use candle_core::{Device, Tensor};
use sps_kernels::inference::Scale;
use sps_kernels::network::Network;

use crate::error::Result;
use crate::weights::Weights;

/// The tensor of a weights file that holds the scales: `(maps, 2)`, the image's first and then those of
/// the layers in their order, each a step and the number that stands for 0.
pub(super) const TENSOR: &str = "int8.scales";

/// The scales that weights hold, one for each map; `None` where they hold none.
/// Refuses those that are not as many as the network has maps, and one that is no scale.
pub(super) fn read(network: &Network, weights: &Weights) -> Result<Option<Vec<Scale>>> {
    let Ok(tensor) = weights.get(TENSOR) else {
        return Ok(None);
    };
    let values: Vec<f32> = tensor.flatten_all()?.to_vec1()?;
    Ok(Some(Scale::of_tensor(network, tensor.dims(), &values)?))
}

/// The scales as a tensor of weights.
pub(super) fn tensor(scales: &[Scale]) -> Result<Tensor> {
    let rows: Vec<f32> = scales.iter().flat_map(|s| [s.step, s.zero]).collect();
    Ok(Tensor::from_vec(rows, (scales.len(), 2), &Device::Cpu)?)
}
