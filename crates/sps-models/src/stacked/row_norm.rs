use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor, bail};

use super::{Element, Output, elements, for_element, with_elements};

/// The Euclidean norm over the last axis: `(trials, rows, dimensions)` gives `(trials, rows)`.
///
/// The gradient is `x / |x|`, and zero at zero, the subgradient of least norm. Computed in f64,
/// with the largest element scaled out, so that no square overflows or vanishes.
pub(crate) fn row_norm(x: &Tensor) -> Result<Tensor> {
    x.contiguous()?.apply_op1(RowNorm)
}

struct RowNorm;

const NAME: &str = "row norm";

fn norm<T: Element>(row: &[T]) -> f64 {
    let largest = row.iter().fold(0.0_f64, |max, x| max.max(x.to_f64().abs()));
    if largest == 0.0 {
        return 0.0;
    }
    let squares = row.iter().map(|x| (x.to_f64() / largest).powi(2));
    largest * squares.sum::<f64>().sqrt()
}

fn forward<T: Element>(storage: &CpuStorage, layout: &Layout) -> Output {
    let [trials, rows, dimensions] = *layout.dims() else {
        bail!(
            "{NAME}: shape {:?} is not (trials, rows, dimensions)",
            layout.shape()
        )
    };
    let values = elements::<T>(NAME, storage, layout)?
        .chunks_exact(dimensions.max(1))
        .map(|row| T::from_f64(norm(row)))
        .collect();
    Ok((T::storage(values), Shape::from((trials, rows))))
}

fn backward<T: Element>(x: &Tensor, gradient: &Tensor) -> Result<Tensor> {
    let dimensions = x.dim(2)?.max(1);
    let values: Vec<T> = with_elements::<T, _>(NAME, x, |x| {
        with_elements::<T, _>(NAME, gradient, |gradient| {
            let mut values = Vec::with_capacity(x.len());
            for (row, g) in x.chunks_exact(dimensions).zip(gradient) {
                let norm = norm(row);
                values.extend(row.iter().map(|x| {
                    T::from_f64(if norm == 0.0 {
                        0.0
                    } else {
                        g.to_f64() * (x.to_f64() / norm)
                    })
                }));
            }
            Ok(values)
        })
    })?;
    Tensor::from_vec(values, x.shape(), x.device())
}

impl CustomOp1 for RowNorm {
    fn name(&self) -> &'static str {
        NAME
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Output {
        for_element!(NAME, storage, forward(storage, layout))
    }

    fn bwd(&self, x: &Tensor, _: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        for_element!(NAME, x, backward(x, gradient)).map(Some)
    }
}
