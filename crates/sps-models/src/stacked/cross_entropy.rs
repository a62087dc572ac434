use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor, bail};

use super::{Element, Output, elements, for_element, with_elements};

/// The cross-entropy of each row: `logits` is `(trials, rows, classes)`, `labels` has one entry
/// per trial and row; gives `(trials, rows)`. A row without a label gives 0 and no gradient.
///
/// Computed in f64 with the largest logit taken out; a class without a member needs no care, for
/// its probability is never divided by or taken the logarithm of.
pub(crate) fn cross_entropy(logits: &Tensor, labels: Vec<Option<u32>>) -> Result<Tensor> {
    logits.contiguous()?.apply_op1(CrossEntropy { labels })
}

struct CrossEntropy {
    labels: Vec<Option<u32>>,
}

const NAME: &str = "cross-entropy";

/// The largest logit, and the sum of `e^(logit - largest)`.
fn partition<T: Element>(row: &[T]) -> (f64, f64) {
    let largest = row
        .iter()
        .fold(f64::NEG_INFINITY, |max, z| max.max(z.to_f64()));
    let sum = row.iter().map(|z| (z.to_f64() - largest).exp()).sum();
    (largest, sum)
}

fn row_loss<T: Element>(row: &[T], label: Option<u32>) -> Result<f64> {
    let Some(label) = label else { return Ok(0.0) };
    let Some(logit) = row.get(label as usize) else {
        bail!("{NAME}: label {label} of {} classes", row.len())
    };
    let (largest, sum) = partition(row);
    Ok((largest - logit.to_f64()) + sum.ln())
}

fn forward<T: Element>(labels: &[Option<u32>], storage: &CpuStorage, at: &Layout) -> Output {
    let [trials, rows, classes] = *at.dims() else {
        bail!(
            "{NAME}: shape {:?} is not (trials, rows, classes)",
            at.shape()
        )
    };
    if labels.len() != trials * rows {
        bail!("{NAME}: {} labels for {} rows", labels.len(), trials * rows)
    }
    let values = elements::<T>(NAME, storage, at)?
        .chunks_exact(classes.max(1))
        .zip(labels)
        .map(|(row, &label)| row_loss(row, label).map(T::from_f64))
        .collect::<Result<_>>()?;
    Ok((T::storage(values), Shape::from((trials, rows))))
}

fn backward<T: Element>(
    labels: &[Option<u32>],
    logits: &Tensor,
    gradient: &Tensor,
) -> Result<Tensor> {
    let classes = logits.dim(2)?.max(1);
    let values: Vec<T> = with_elements::<T, _>(NAME, logits, |logits| {
        with_elements::<T, _>(NAME, gradient, |gradient| {
            let mut values = Vec::with_capacity(logits.len());
            for ((row, label), g) in logits.chunks_exact(classes).zip(labels).zip(gradient) {
                let (largest, sum) = partition(row);
                values.extend(row.iter().enumerate().map(|(class, z)| {
                    let Some(label) = *label else {
                        return T::from_f64(0.0);
                    };
                    let probability = (z.to_f64() - largest).exp() / sum;
                    let truth = f64::from(u8::from(class == label as usize));
                    T::from_f64(g.to_f64() * (probability - truth))
                }));
            }
            Ok(values)
        })
    })?;
    Tensor::from_vec(values, logits.shape(), logits.device())
}

impl CustomOp1 for CrossEntropy {
    fn name(&self) -> &'static str {
        NAME
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Output {
        for_element!(NAME, storage, forward(&self.labels, storage, layout))
    }

    fn bwd(&self, logits: &Tensor, _: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        for_element!(NAME, logits, backward(&self.labels, logits, gradient)).map(Some)
    }
}
