use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use candle_core::{CpuStorage, Result, Tensor, Var, WithDType, bail};

use super::Element;
use crate::optim::Gradient;

/// A parameter of every trial of a stack, `(trials, ..)`, and the place for its gradient.
///
/// The operators of this module write the gradient of a parameter there themselves, instead of
/// handing it to candle, which would clear, fill and add three tensors of the parameter's size in
/// every step, in a thread pool of its own that waits by spinning.
#[derive(Clone, Debug)]
pub(crate) struct Parameter {
    value: Tensor,
    gradient: Option<GradientSlot>,
}

impl Parameter {
    /// A parameter to train.
    pub(crate) fn variable(variable: &Var) -> Self {
        Self {
            value: variable.as_tensor().clone(),
            gradient: Some(GradientSlot::default()),
        }
    }

    /// A constant.
    pub(crate) fn constant(value: Tensor) -> Self {
        Self {
            value,
            gradient: None,
        }
    }

    /// The same values as a constant.
    pub(crate) fn frozen(&self) -> Self {
        Self::constant(self.value.detach())
    }

    pub(crate) fn value(&self) -> &Tensor {
        &self.value
    }

    /// Where the gradient goes; `None` for a constant.
    pub(crate) fn gradient(&self) -> Option<&GradientSlot> {
        self.gradient.as_ref()
    }
}

/// The gradient of one parameter; clones share it.
#[derive(Clone, Debug, Default)]
pub(crate) struct GradientSlot(Arc<Mutex<Content>>);

#[derive(Debug, Default)]
struct Content {
    values: Option<CpuStorage>,
    /// Whether something was written since it was cleared.
    written: bool,
}

impl GradientSlot {
    /// Forgets the gradient, and keeps the memory for the next.
    pub(crate) fn clear(&self) {
        self.content().written = false;
    }

    pub(crate) fn is_written(&self) -> bool {
        self.content().written
    }

    /// Hands `length` values to `write`, which adds to them when told so and else overwrites.
    pub(super) fn write<T: Element>(&self, length: usize, write: impl FnOnce(&mut [T], bool)) {
        let mut content = self.content();
        let Content { values, written } = &mut *content;
        let kept = values.as_mut().and_then(T::slice_mut);
        if kept.map(|kept| kept.len()) != Some(length) {
            *values = Some(T::to_cpu_storage_owned(vec![T::zero(); length]));
            *written = false;
        }
        if let Some(values) = values.as_mut().and_then(T::slice_mut) {
            write(values, *written);
            *written = true;
        }
    }

    fn content(&self) -> MutexGuard<'_, Content> {
        // A panic elsewhere leaves numbers here, never a broken state.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Gradient for GradientSlot {
    fn read<T: WithDType, R>(&self, body: impl FnOnce(&[T]) -> Result<R>) -> Result<R> {
        let content = self.content();
        match &content.values {
            Some(values) if content.written => body(T::cpu_storage_as_slice(values)?),
            _ => bail!("a parameter has no gradient"),
        }
    }
}
