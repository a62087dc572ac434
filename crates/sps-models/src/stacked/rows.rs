use candle_core::{Result, Shape, Tensor, WithDType, bail};

use super::for_element;
use crate::differentiable::{differentiable, with_values};

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
    pointwise(z, value, derivative)
}

/// `max(z, 0.2 z)`, the slope that DCGAN (Radford et al. 2016) gives its discriminator.
pub(crate) fn leaky_relu(z: &Tensor) -> Result<Tensor> {
    let derivative = |z| if z > 0.0 { 1.0 } else { 0.2 };
    pointwise(z, |z| z.max(0.2 * z), derivative)
}

/// A function of each element, with its derivative.
fn pointwise(z: &Tensor, value: fn(f64) -> f64, derivative: fn(f64) -> f64) -> Result<Tensor> {
    let slope = move |_, z: &mut [f64], g| z[0] = derivative(z[0]) * g;
    by_rows(z, 1, z.shape().clone(), |_, z| Ok(value(z[0])), slope)
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
    let slope = |_, row: &mut [f64], g| match norm(row) {
        0.0 => row.fill(0.0),
        norm => row.iter_mut().for_each(|x| *x = g * (*x / norm)),
    };
    let shape = (trials, rows).into();
    by_rows(x, width, shape, |_, row| Ok(norm(row)), slope)
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
        let (found, rows) = (labels.len(), trials * rows);
        bail!("cross-entropy: {found} labels for {rows} rows")
    }
    let of_rows = labels.clone();
    let value = move |at, row: &[f64]| {
        let Some(label) = labels[at] else {
            return Ok(0.0);
        };
        let Some(logit) = row.get(label as usize) else {
            bail!("cross-entropy: label {label} of {} classes", row.len())
        };
        let (largest, sum) = partition(row);
        Ok((largest - logit) + sum.ln())
    };
    let slope = move |at, row: &mut [f64], g| {
        let Some(label) = of_rows[at] else {
            return row.fill(0.0);
        };
        let (largest, sum) = partition(row);
        for (class, z) in row.iter_mut().enumerate() {
            let truth = f64::from(u8::from(class == label as usize));
            *z = g * ((*z - largest).exp() / sum - truth);
        }
    };
    by_rows(logits, width, (trials, rows).into(), value, slope)
}

/// An operator that makes one number of each row of `width`, computed in f64 for either type.
///
/// `value` gives the number of a row, by its place and what is in it; `slope` puts the gradient of a row in
/// its place, from that of its number.
fn by_rows(
    x: &Tensor,
    width: usize,
    shape: Shape,
    value: impl Fn(usize, &[f64]) -> Result<f64>,
    slope: impl Fn(usize, &mut [f64], f64) + Send + Sync + 'static,
) -> Result<Tensor> {
    let (x, width) = (x.contiguous()?, width.max(1));
    for_element!(x, T => {
        let numbers = wide::<T>(&x)?;
        let rows = numbers.chunks_exact(width).enumerate();
        let values = rows.map(|(at, row)| value(at, row).map(T::from_f64));
        let backward = move |x: &Tensor, gradient: &Tensor| {
            let mut slopes = wide::<T>(x)?;
            with_values(gradient, |gradient: &[T]| {
                let rows = slopes.chunks_exact_mut(width).enumerate();
                rows.zip(gradient).for_each(|((at, row), g)| slope(at, row, g.to_f64()));
                Ok(())
            })?;
            let slopes: Vec<T> = slopes.into_iter().map(T::from_f64).collect();
            Tensor::from_vec(slopes, x.shape(), x.device()).map(Some)
        };
        differentiable([&x; 2], values.collect::<Result<_>>()?, shape, backward)
    })
}

/// A tensor's numbers in f64.
fn wide<T: WithDType>(x: &Tensor) -> Result<Vec<f64>> {
    with_values(x, |x: &[T]| Ok(x.iter().map(|x| x.to_f64()).collect()))
}
