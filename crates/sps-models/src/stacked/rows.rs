use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor, bail};

use super::{Element, Output, elements, for_element, with_elements};

/// `log(1 + e^z)`, finite for every finite `z`, with the logistic function as its derivative.
///
/// With `z` a logit, `log D = -softplus(-z)` and `log(1 - D) = -softplus(z)`.
pub(crate) fn softplus(z: &Tensor) -> Result<Tensor> {
    let value = |z: f64| z.max(0.0) + (-z.abs()).exp().ln_1p();
    let derivative = |z: f64| {
        // Either form is exact on its own side; the other would overflow.
        let tail = (-z.abs()).exp();
        (if z >= 0.0 { 1.0 } else { tail }) / (1.0 + tail)
    };
    pointwise("softplus", z, value, derivative)
}

/// `max(z, 0.2 z)`, the slope that DCGAN (Radford et al. 2016) gives its discriminator.
pub(crate) fn leaky_relu(z: &Tensor) -> Result<Tensor> {
    let derivative = |z| if z > 0.0 { 1.0 } else { 0.2 };
    pointwise("leaky relu", z, |z| z.max(0.2 * z), derivative)
}

/// A function of each element, with its derivative.
fn pointwise(
    name: &'static str,
    z: &Tensor,
    value: fn(f64) -> f64,
    derivative: fn(f64) -> f64,
) -> Result<Tensor> {
    z.contiguous()?.apply_op1(Rows {
        name,
        width: 1,
        shape: z.shape().clone(),
        value: move |_, z: &[f64]| Ok(value(z[0])),
        slope: move |_, z: &mut [f64], g| z[0] = derivative(z[0]) * g,
    })
}

/// The Euclidean norm over the last axis: `(trials, rows, dimensions)` gives `(trials, rows)`.
///
/// The gradient is `x / |x|`, and zero at zero, the subgradient of least norm. The largest element is
/// scaled out, so that no square overflows or vanishes.
pub(crate) fn row_norm(x: &Tensor) -> Result<Tensor> {
    fn norm(row: &[f64]) -> f64 {
        let largest = row.iter().fold(0.0_f64, |max, x| max.max(x.abs()));
        if largest == 0.0 {
            return 0.0;
        }
        let squares = row.iter().map(|x| (x / largest).powi(2));
        largest * squares.sum::<f64>().sqrt()
    }
    let (trials, rows, width) = x.dims3()?;
    x.contiguous()?.apply_op1(Rows {
        name: "row norm",
        width,
        shape: (trials, rows).into(),
        value: |_, row: &[f64]| Ok(norm(row)),
        slope: |_, row: &mut [f64], g| match norm(row) {
            0.0 => row.fill(0.0),
            norm => row.iter_mut().for_each(|x| *x = g * (*x / norm)),
        },
    })
}

/// The cross-entropy of each row: `logits` is `(trials, rows, classes)`, `labels` has one entry
/// per trial and row; gives `(trials, rows)`. A row without a label gives 0 and no gradient.
///
/// The largest logit is taken out; a class without a member needs no care, for its probability is never
/// divided by or taken the logarithm of.
pub(crate) fn cross_entropy(logits: &Tensor, labels: Vec<Option<u32>>) -> Result<Tensor> {
    /// The largest logit, and the sum of `e^(logit - largest)`.
    fn partition(row: &[f64]) -> (f64, f64) {
        let largest = row.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (largest, row.iter().map(|z| (z - largest).exp()).sum())
    }
    let (trials, rows, width) = logits.dims3()?;
    if labels.len() != trials * rows {
        bail!(
            "cross-entropy: {} labels for {} rows",
            labels.len(),
            trials * rows
        )
    }
    let of_rows = labels.clone();
    logits.contiguous()?.apply_op1(Rows {
        name: "cross-entropy",
        width,
        shape: (trials, rows).into(),
        value: move |at, row: &[f64]| {
            let Some(label) = labels[at] else {
                return Ok(0.0);
            };
            let Some(logit) = row.get(label as usize) else {
                bail!("cross-entropy: label {label} of {} classes", row.len())
            };
            let (largest, sum) = partition(row);
            Ok((largest - logit) + sum.ln())
        },
        slope: move |at, row: &mut [f64], g| {
            let Some(label) = of_rows[at] else {
                return row.fill(0.0);
            };
            let (largest, sum) = partition(row);
            for (class, z) in row.iter_mut().enumerate() {
                let truth = f64::from(u8::from(class == label as usize));
                *z = g * ((*z - largest).exp() / sum - truth);
            }
        },
    })
}

/// An operator that makes one number of each row, computed in f64 for either type.
struct Rows<V, S> {
    name: &'static str,
    /// Numbers of a row.
    width: usize,
    /// Of what it gives.
    shape: Shape,
    /// The number of a row, which is also given by its place.
    value: V,
    /// Puts the gradient of a row in its place, from that of its number.
    slope: S,
}

impl<V, S> Rows<V, S>
where
    V: Fn(usize, &[f64]) -> Result<f64>,
    S: Fn(usize, &mut [f64], f64),
{
    fn forward<T: Element>(&self, storage: &CpuStorage, layout: &Layout) -> Output {
        let x = wide(elements::<T>(self.name, storage, layout)?);
        let rows = x.chunks_exact(self.width.max(1)).enumerate();
        let values = rows.map(|(at, row)| (self.value)(at, row).map(T::from_f64));
        Ok((
            T::storage(values.collect::<Result<_>>()?),
            self.shape.clone(),
        ))
    }

    fn backward<T: Element>(&self, x: &Tensor, gradient: &Tensor) -> Result<Tensor> {
        let mut slopes = with_elements::<T, _>(self.name, x, |x| Ok(wide(x)))?;
        with_elements::<T, _>(self.name, gradient, |gradient| {
            let rows = slopes.chunks_exact_mut(self.width.max(1)).enumerate();
            for ((at, row), g) in rows.zip(gradient) {
                (self.slope)(at, row, g.to_f64());
            }
            Ok(())
        })?;
        let slopes: Vec<T> = slopes.into_iter().map(T::from_f64).collect();
        Tensor::from_vec(slopes, x.shape(), x.device())
    }
}

fn wide<T: Element>(values: &[T]) -> Vec<f64> {
    values.iter().map(|x| x.to_f64()).collect()
}

impl<V, S> CustomOp1 for Rows<V, S>
where
    V: Fn(usize, &[f64]) -> Result<f64> + Send + Sync,
    S: Fn(usize, &mut [f64], f64) + Send + Sync,
{
    fn name(&self) -> &'static str {
        self.name
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Output {
        for_element!(self.name, storage, T => self.forward::<T>(storage, layout))
    }

    fn bwd(&self, x: &Tensor, _: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        for_element!(self.name, x, T => self.backward::<T>(x, gradient)).map(Some)
    }
}
