use candle_core::{Result, Tensor, bail};
use faer::{Accum, MatMut, MatRef};
use sps_regress::dense::multiply;

use super::{Element, GradientSlot, Parameter, for_element, part};
use crate::differentiable::{differentiable, with_values};

/// `x w + b` for each trial: `x` is `(trials, rows, inputs)`, `w` `(trials, inputs, outputs)`,
/// `b` `(trials, outputs)`; gives `(trials, rows, outputs)`.
pub(crate) fn linear(x: &Tensor, w: &Parameter, b: &Parameter) -> Result<Tensor> {
    for_element!(x, T => product::<T>(x, w, Some(b)))
}

/// `x w` for each trial, shapes as in [`linear`].
pub(crate) fn matmul(x: &Tensor, w: &Parameter) -> Result<Tensor> {
    for_element!(x, T => product::<T>(x, w, None))
}

/// `(trials, rows, inputs, outputs)` of a product.
type Dims = [usize; 4];

fn dims(x: &Tensor, w: &Tensor) -> Result<Dims> {
    let (trials, rows, inputs) = x.dims3()?;
    let (of, from, outputs) = w.dims3()?;
    if (of, from) != (trials, inputs) {
        bail!("stacked linear: inputs {x:?} do not fit weights {w:?}")
    }
    Ok([trials, rows, inputs, outputs])
}

/// The matrix of one trial.
fn matrix<T>(values: &[T], trial: usize, [rows, columns]: [usize; 2]) -> MatRef<'_, T> {
    MatRef::from_row_major_slice(&values[part(trial, rows * columns)], rows, columns)
}

fn matrix_mut<T>(values: &mut [T], trial: usize, [rows, columns]: [usize; 2]) -> MatMut<'_, T> {
    MatMut::from_row_major_slice_mut(&mut values[part(trial, rows * columns)], rows, columns)
}

fn product<T: Element>(x: &Tensor, w: &Parameter, bias: Option<&Parameter>) -> Result<Tensor> {
    let dims = dims(x, w.value())?;
    let [trials, rows, inputs, outputs] = dims;
    let x = x.contiguous()?;
    let mut y = vec![T::zero(); trials * rows * outputs];
    let mut accumulate = Accum::Replace;
    if let Some(bias) = bias.map(Parameter::value) {
        if bias.dims() != [trials, outputs] {
            bail!("stacked linear: bias {:?}", bias.shape())
        }
        with_values::<T, _>(bias, |bias| {
            for trial in 0..trials {
                let y = &mut y[part(trial, rows * outputs)];
                for row in y.chunks_exact_mut(outputs.max(1)) {
                    row.copy_from_slice(&bias[part(trial, outputs)]);
                }
            }
            Ok(())
        })?;
        accumulate = Accum::Add;
    }
    with_values::<T, _>(&x, |x| {
        with_values::<T, _>(w.value(), |w| {
            for trial in 0..trials {
                multiply(
                    matrix_mut(&mut y, trial, [rows, outputs]),
                    accumulate,
                    matrix(x, trial, [rows, inputs]),
                    matrix(w, trial, [inputs, outputs]),
                );
            }
            Ok(())
        })
    })?;
    let (weight, bias) = (w.clone(), bias.cloned());
    // A constant has no place for its gradient, and none is computed.
    let backward = move |x: &Tensor, dy: &Tensor| {
        if let Some(slot) = weight.gradient() {
            weight_gradient::<T>(dims, x, dy, slot)?;
        }
        if let Some(slot) = bias.as_ref().and_then(Parameter::gradient) {
            bias_gradient::<T>(dims, dy, slot)?;
        }
        let of_input = || input_gradient::<T>(dims, weight.value(), dy);
        x.track_op().then(of_input).transpose()
    };
    differentiable([&x, w.value()], y, (trials, rows, outputs), backward)
}

/// `x^T dy`, `(trials, inputs, outputs)`.
fn weight_gradient<T: Element>(
    [trials, rows, inputs, outputs]: Dims,
    x: &Tensor,
    dy: &Tensor,
    slot: &GradientSlot,
) -> Result<()> {
    with_values::<T, _>(x, |x| {
        with_values::<T, _>(dy, |dy| {
            slot.write::<T>(trials * inputs * outputs, |dw, add| {
                for trial in 0..trials {
                    multiply(
                        matrix_mut(dw, trial, [inputs, outputs]),
                        if add { Accum::Add } else { Accum::Replace },
                        matrix(x, trial, [rows, inputs]).transpose(),
                        matrix(dy, trial, [rows, outputs]),
                    );
                }
            });
            Ok(())
        })
    })
}

/// `dy w^T`, `(trials, rows, inputs)`.
fn input_gradient<T: Element>(
    [trials, rows, inputs, outputs]: Dims,
    w: &Tensor,
    dy: &Tensor,
) -> Result<Tensor> {
    let mut dx = vec![T::zero(); trials * rows * inputs];
    with_values::<T, _>(w, |w| {
        with_values::<T, _>(dy, |dy| {
            for trial in 0..trials {
                multiply(
                    matrix_mut(&mut dx, trial, [rows, inputs]),
                    Accum::Replace,
                    matrix(dy, trial, [rows, outputs]),
                    matrix(w, trial, [inputs, outputs]).transpose(),
                );
            }
            Ok(())
        })
    })?;
    Tensor::from_vec(dx, (trials, rows, inputs), w.device())
}

/// The sum of `dy` over the rows, `(trials, outputs)`.
fn bias_gradient<T: Element>(
    [trials, rows, _, outputs]: Dims,
    dy: &Tensor,
    slot: &GradientSlot,
) -> Result<()> {
    with_values::<T, _>(dy, |dy| {
        slot.write::<T>(trials * outputs, |db, add| {
            if !add {
                db.fill(T::zero());
            }
            for trial in 0..trials {
                let db = &mut db[part(trial, outputs)];
                for row in dy[part(trial, rows * outputs)].chunks_exact(outputs.max(1)) {
                    for (sum, &value) in db.iter_mut().zip(row) {
                        *sum += value;
                    }
                }
            }
        });
        Ok(())
    })
}
