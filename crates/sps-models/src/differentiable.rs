//! Work on slices as an operator of candle, with gradients.

use std::sync::{Mutex, PoisonError};

use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Storage, Tensor, bail};

/// The gradients of an operator's inputs, where there are any.
pub(crate) type InputGradients = [Option<Vec<f32>>; 3];

/// The output of an operator that has run, f32 on the CPU, as a tensor that candle differentiates.
///
/// `backward` gives the inputs' gradients from the output and its gradient: that of every input that
/// is computed from a variable. An operator with fewer inputs names one of them again.
pub(crate) fn differentiable<B>(
    inputs: [&Tensor; 3],
    output: Vec<f32>,
    shape: impl Into<Shape>,
    backward: B,
) -> Result<Tensor>
where
    B: Fn(&[f32], &[f32]) -> Result<InputGradients> + Send + Sync + 'static,
{
    let [first, second, third] = inputs;
    let operator = Operator {
        output: Mutex::new(output),
        shape: shape.into(),
        backward,
    };
    first.apply_op3(second, third, operator)
}

struct Operator<B> {
    /// Until candle takes it.
    output: Mutex<Vec<f32>>,
    shape: Shape,
    backward: B,
}

impl<B> CustomOp3 for Operator<B>
where
    B: Fn(&[f32], &[f32]) -> Result<InputGradients> + Send + Sync,
{
    fn name(&self) -> &'static str {
        "an operator of sps-models"
    }

    fn cpu_fwd(
        &self,
        _: &CpuStorage,
        _: &Layout,
        _: &CpuStorage,
        _: &Layout,
        _: &CpuStorage,
        _: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let mut output = self.output.lock().unwrap_or_else(PoisonError::into_inner);
        let output = CpuStorage::F32(std::mem::take(&mut output));
        Ok((output, self.shape.clone()))
    }

    fn bwd(
        &self,
        first: &Tensor,
        second: &Tensor,
        third: &Tensor,
        output: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let [a, b, c] = with_values(output, |output| {
            with_values(gradient, |gradient| (self.backward)(output, gradient))
        })?;
        let tensor = |values: Option<Vec<f32>>, like: &Tensor| {
            let values = values.map(|values| Tensor::from_vec(values, like.dims(), like.device()));
            values.transpose()
        };
        Ok((tensor(a, first)?, tensor(b, second)?, tensor(c, third)?))
    }
}

/// Calls `work` with a tensor's numbers, row-major.
pub(crate) fn with_values<T>(tensor: &Tensor, work: impl FnOnce(&[f32]) -> Result<T>) -> Result<T> {
    let tensor = tensor.contiguous()?;
    let (storage, layout) = tensor.storage_and_layout();
    match (&*storage, layout.contiguous_offsets()) {
        (Storage::Cpu(CpuStorage::F32(all)), Some((from, to))) => work(&all[from..to]),
        _ => bail!("an operator takes f32 tensors on the CPU, not {tensor:?}"),
    }
}
