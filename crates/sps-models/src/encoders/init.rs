//! Starting weights, drawn from a seed.

use sps_base::streams::{RngCore, hashed_stream};

use crate::error::Result;
use crate::weights::{RawTensor, TensorSpec, Weights};

/// Weights of a network that nothing has trained.
///
/// A convolution is uniform with the variance of He et al. (2015), 2 / fan-in; a bias and a
/// running mean are 0, batch norm's weight and running variance 1. Each tensor has its own
/// stream, keyed by seed and name.
pub(super) fn seeded(specs: &[TensorSpec], seed: u64) -> Result<Weights> {
    let tensors = specs.iter().map(|spec| {
        let len = spec.shape.iter().product();
        let values = match spec.name.rsplit('.').next() {
            Some("bias" | "running_mean") => vec![0.0; len],
            _ if spec.shape.len() == 1 => vec![1.0; len],
            _ => he_uniform(spec, len, seed),
        };
        let shape = spec.shape.clone();
        (spec.name.clone(), RawTensor { shape, values })
    });
    Ok(Weights::from_raw(&format!("seed {seed}"), tensors)?)
}

fn he_uniform(spec: &TensorSpec, len: usize, seed: u64) -> Vec<f32> {
    let fan_in: usize = spec.shape.iter().skip(1).product();
    let bound = (6.0 / fan_in as f64).sqrt();
    let name = [&seed.to_le_bytes(), spec.name.as_bytes()];
    let mut rng = hashed_stream("sps-models encoder initialisation", name);
    let unit = |bits: u32| f64::from(bits >> 8) / f64::from(1 << 23) - 1.0;
    let value = |_| (unit(rng.next_u32()) * bound) as f32;
    (0..len).map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As drawn before this crate shared its streams with others: a result depends on them.
    #[test]
    fn a_tensor_starts_as_it_always_did() {
        let spec = TensorSpec::new("a.weight", &[4, 6]);
        let expected = [0.613_587_86, -0.897_252_1, 0.144_367_34, -0.901_644_1];
        assert_eq!(he_uniform(&spec, 4, 7), expected);
    }
}
