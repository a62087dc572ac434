use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor, bail};
use faer::{Accum, MatMut, MatRef};
use sps_regress::dense::multiply;

use super::{Element, GradientSlot, Output, Parameter, elements, for_element, with_elements};

/// `x w + b` for each trial: `x` is `(trials, rows, inputs)`, `w` `(trials, inputs, outputs)`,
/// `b` `(trials, outputs)`; gives `(trials, rows, outputs)`.
pub(crate) fn linear(x: &Tensor, w: &Parameter, b: &Parameter) -> Result<Tensor> {
    let operator = Linear {
        weight: w.gradient().cloned(),
        bias: b.gradient().cloned(),
        biased: true,
    };
    x.contiguous()?.apply_op3(w.value(), b.value(), operator)
}

/// `x w` for each trial, shapes as in [`linear`].
pub(crate) fn matmul(x: &Tensor, w: &Parameter) -> Result<Tensor> {
    let operator = Linear {
        weight: w.gradient().cloned(),
        bias: None,
        biased: false,
    };
    // The third operand is not looked at.
    x.contiguous()?.apply_op3(w.value(), w.value(), operator)
}

/// Where the parameters' gradients go; a constant has no place, and none is computed.
struct Linear {
    weight: Option<GradientSlot>,
    bias: Option<GradientSlot>,
    biased: bool,
}

const NAME: &str = "stacked linear";

/// `(trials, rows, inputs, outputs)` of a product.
#[derive(Clone, Copy)]
struct Dims {
    trials: usize,
    rows: usize,
    inputs: usize,
    outputs: usize,
}

impl Dims {
    fn new(x: &Shape, w: &Shape) -> Result<Self> {
        let (trials, rows, inputs) = x.dims3()?;
        let (of, from, outputs) = w.dims3()?;
        if (of, from) != (trials, inputs) {
            bail!("{NAME}: inputs {x:?} do not fit weights {w:?}")
        }
        Ok(Self {
            trials,
            rows,
            inputs,
            outputs,
        })
    }

    fn x(self, trial: usize) -> std::ops::Range<usize> {
        part(trial, self.rows * self.inputs)
    }

    fn w(self, trial: usize) -> std::ops::Range<usize> {
        part(trial, self.inputs * self.outputs)
    }

    fn y(self, trial: usize) -> std::ops::Range<usize> {
        part(trial, self.rows * self.outputs)
    }
}

fn part(trial: usize, length: usize) -> std::ops::Range<usize> {
    trial * length..(trial + 1) * length
}

fn forward<T: Element>(
    dims: Dims,
    (x, x_at): (&CpuStorage, &Layout),
    (w, w_at): (&CpuStorage, &Layout),
    bias: Option<(&CpuStorage, &Layout)>,
) -> Output {
    let x = elements::<T>(NAME, x, x_at)?;
    let w = elements::<T>(NAME, w, w_at)?;
    let mut y = vec![T::zero(); dims.trials * dims.rows * dims.outputs];
    let accumulate = match bias {
        None => Accum::Replace,
        Some((b, b_at)) => {
            if b_at.dims() != [dims.trials, dims.outputs] {
                bail!("{NAME}: bias {:?}", b_at.shape())
            }
            let b = elements::<T>(NAME, b, b_at)?;
            for trial in 0..dims.trials {
                let b = &b[part(trial, dims.outputs)];
                for row in y[dims.y(trial)].chunks_exact_mut(dims.outputs.max(1)) {
                    row.copy_from_slice(b);
                }
            }
            Accum::Add
        }
    };
    for trial in 0..dims.trials {
        multiply(
            MatMut::from_row_major_slice_mut(&mut y[dims.y(trial)], dims.rows, dims.outputs),
            accumulate,
            MatRef::from_row_major_slice(&x[dims.x(trial)], dims.rows, dims.inputs),
            MatRef::from_row_major_slice(&w[dims.w(trial)], dims.inputs, dims.outputs),
        );
    }
    Ok((
        T::storage(y),
        Shape::from((dims.trials, dims.rows, dims.outputs)),
    ))
}

/// `x^T dy`, `(trials, inputs, outputs)`.
fn weight_gradient<T: Element>(
    dims: Dims,
    x: &Tensor,
    dy: &Tensor,
    slot: &GradientSlot,
) -> Result<()> {
    with_elements::<T, _>(NAME, x, |x| {
        with_elements::<T, _>(NAME, dy, |dy| {
            slot.write::<T>(dims.trials * dims.inputs * dims.outputs, |dw, add| {
                for trial in 0..dims.trials {
                    let dw = &mut dw[dims.w(trial)];
                    multiply(
                        MatMut::from_row_major_slice_mut(dw, dims.inputs, dims.outputs),
                        if add { Accum::Add } else { Accum::Replace },
                        MatRef::from_row_major_slice(&x[dims.x(trial)], dims.rows, dims.inputs)
                            .transpose(),
                        MatRef::from_row_major_slice(&dy[dims.y(trial)], dims.rows, dims.outputs),
                    );
                }
            });
            Ok(())
        })
    })
}

/// `dy w^T`, `(trials, rows, inputs)`.
fn input_gradient<T: Element>(dims: Dims, w: &Tensor, dy: &Tensor) -> Result<Tensor> {
    let mut dx = vec![T::zero(); dims.trials * dims.rows * dims.inputs];
    with_elements::<T, _>(NAME, w, |w| {
        with_elements::<T, _>(NAME, dy, |dy| {
            for trial in 0..dims.trials {
                multiply(
                    MatMut::from_row_major_slice_mut(
                        &mut dx[dims.x(trial)],
                        dims.rows,
                        dims.inputs,
                    ),
                    Accum::Replace,
                    MatRef::from_row_major_slice(&dy[dims.y(trial)], dims.rows, dims.outputs),
                    MatRef::from_row_major_slice(&w[dims.w(trial)], dims.inputs, dims.outputs)
                        .transpose(),
                );
            }
            Ok(())
        })
    })?;
    Tensor::from_vec(dx, (dims.trials, dims.rows, dims.inputs), w.device())
}

/// The sum of `dy` over the rows, `(trials, outputs)`.
fn bias_gradient<T: Element>(dims: Dims, dy: &Tensor, slot: &GradientSlot) -> Result<()> {
    with_elements::<T, _>(NAME, dy, |dy| {
        slot.write::<T>(dims.trials * dims.outputs, |db, add| {
            if !add {
                db.fill(T::zero());
            }
            for trial in 0..dims.trials {
                let db = &mut db[part(trial, dims.outputs)];
                for row in dy[dims.y(trial)].chunks_exact(dims.outputs.max(1)) {
                    for (sum, &value) in db.iter_mut().zip(row) {
                        *sum += value;
                    }
                }
            }
        });
        Ok(())
    })
}

impl Linear {
    /// Writes the parameters' gradients, and gives the input's where something asks for it.
    fn backward(&self, x: &Tensor, w: &Tensor, dy: &Tensor) -> Result<Option<Tensor>> {
        let dims = Dims::new(x.shape(), w.shape())?;
        if let Some(slot) = &self.weight {
            for_element!(NAME, dy, T => weight_gradient::<T>(dims, x, dy, slot))?;
        }
        if let Some(slot) = &self.bias {
            for_element!(NAME, dy, T => bias_gradient::<T>(dims, dy, slot))?;
        }
        x.track_op()
            .then(|| for_element!(NAME, dy, T => input_gradient::<T>(dims, w, dy)))
            .transpose()
    }
}

impl CustomOp3 for Linear {
    fn name(&self) -> &'static str {
        NAME
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_at: &Layout,
        w: &CpuStorage,
        w_at: &Layout,
        b: &CpuStorage,
        b_at: &Layout,
    ) -> Output {
        let dims = Dims::new(x_at.shape(), w_at.shape())?;
        let bias = self.biased.then_some((b, b_at));
        for_element!(NAME, x, T => forward::<T>(dims, (x, x_at), (w, w_at), bias))
    }

    fn bwd(
        &self,
        x: &Tensor,
        w: &Tensor,
        _: &Tensor,
        _: &Tensor,
        dy: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        Ok((self.backward(x, w, dy)?, None, None))
    }
}
