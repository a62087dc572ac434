use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Tensor};

use super::{Element, Output, elements, for_element, with_elements};

/// `log(1 + e^z)`, finite for every finite `z`, with the logistic function as its derivative.
///
/// With `z` a logit, `log D = -softplus(-z)` and `log(1 - D) = -softplus(z)`.
pub(crate) fn softplus(z: &Tensor) -> Result<Tensor> {
    z.contiguous()?.apply_op1(Pointwise {
        name: "softplus",
        value: |z| z.max(0.0) + (-z.abs()).exp().ln_1p(),
        derivative: |z| {
            // Either form is exact on its own side; the other would overflow.
            let tail = (-z.abs()).exp();
            (if z >= 0.0 { 1.0 } else { tail }) / (1.0 + tail)
        },
    })
}

/// `max(z, 0.2 z)`, the slope that DCGAN (Radford et al. 2016) gives its discriminator.
pub(crate) fn leaky_relu(z: &Tensor) -> Result<Tensor> {
    z.contiguous()?.apply_op1(Pointwise {
        name: "leaky relu",
        value: |z| z.max(0.2 * z),
        derivative: |z| if z > 0.0 { 1.0 } else { 0.2 },
    })
}

/// A function of each element, with its derivative; computed in f64 for either type.
#[derive(Clone, Copy)]
struct Pointwise {
    name: &'static str,
    value: fn(f64) -> f64,
    derivative: fn(f64) -> f64,
}

fn forward<T: Element>(operator: Pointwise, storage: &CpuStorage, layout: &Layout) -> Output {
    let values = elements::<T>(operator.name, storage, layout)?
        .iter()
        .map(|z| T::from_f64((operator.value)(z.to_f64())))
        .collect();
    Ok((T::storage(values), layout.shape().clone()))
}

fn backward<T: Element>(operator: Pointwise, z: &Tensor, gradient: &Tensor) -> Result<Tensor> {
    let name = operator.name;
    let values: Vec<T> = with_elements::<T, _>(name, z, |z| {
        with_elements::<T, _>(name, gradient, |gradient| {
            Ok(z.iter()
                .zip(gradient)
                .map(|(z, g)| T::from_f64((operator.derivative)(z.to_f64()) * g.to_f64()))
                .collect())
        })
    })?;
    Tensor::from_vec(values, z.shape(), z.device())
}

impl CustomOp1 for Pointwise {
    fn name(&self) -> &'static str {
        self.name
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Output {
        for_element!(self.name, storage, forward(*self, storage, layout))
    }

    fn bwd(&self, z: &Tensor, _: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        for_element!(self.name, z, backward(*self, z, gradient)).map(Some)
    }
}
