//! Work on slices as operators of candle, with gradients.

use std::sync::{Mutex, PoisonError};

use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Storage, Tensor, WithDType, bail};

/// The output of an operator that has run, on the CPU, as a tensor that candle differentiates.
///
/// `backward` gives the gradient of the first input from that input and the output's gradient. The second
/// input gets none: it says what else a variable is behind, without which candle takes no backward pass.
pub(crate) fn differentiable<T, B>(
    [first, second]: [&Tensor; 2],
    output: Vec<T>,
    shape: impl Into<Shape>,
    backward: B,
) -> Result<Tensor>
where
    T: WithDType,
    B: Fn(&Tensor, &Tensor) -> Result<Option<Tensor>> + Send + Sync + 'static,
{
    let operator = Operator {
        output: Mutex::new(Some(T::to_cpu_storage_owned(output))),
        shape: shape.into(),
        backward,
    };
    first.apply_op2(second, operator)
}

struct Operator<B> {
    /// Until candle takes it.
    output: Mutex<Option<CpuStorage>>,
    shape: Shape,
    backward: B,
}

impl<B> CustomOp2 for Operator<B>
where
    B: Fn(&Tensor, &Tensor) -> Result<Option<Tensor>> + Send + Sync,
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
    ) -> Result<(CpuStorage, Shape)> {
        let mut output = self.output.lock().unwrap_or_else(PoisonError::into_inner);
        match output.take() {
            Some(output) => Ok((output, self.shape.clone())),
            None => bail!("{} has no output a second time", self.name()),
        }
    }

    fn bwd(
        &self,
        first: &Tensor,
        _: &Tensor,
        _: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        Ok(((self.backward)(first, gradient)?, None))
    }
}

/// Calls `work` with a tensor's numbers, row-major.
pub(crate) fn with_values<T: WithDType, R>(
    tensor: &Tensor,
    work: impl FnOnce(&[T]) -> Result<R>,
) -> Result<R> {
    let tensor = tensor.contiguous()?;
    let (storage, layout) = tensor.storage_and_layout();
    match (&*storage, layout.contiguous_offsets()) {
        (Storage::Cpu(all), Some((from, to))) => work(&T::cpu_storage_as_slice(all)?[from..to]),
        _ => bail!("an operator takes tensors on the CPU, not {tensor:?}"),
    }
}
