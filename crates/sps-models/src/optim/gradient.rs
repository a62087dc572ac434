use candle_core::{CpuStorage, Result, Storage, Tensor, bail};

/// The elements of a gradient, in row-major order.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Elements<'a> {
    /// Single precision.
    F32(&'a [f32]),
    /// Double precision.
    F64(&'a [f64]),
}

impl Elements<'_> {
    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::F64(values) => values.len(),
        }
    }
}

/// Something that holds the gradient of one parameter.
pub(crate) trait Gradient {
    /// Shows the elements to `body`.
    fn read(&self, body: &mut dyn FnMut(Elements<'_>) -> Result<()>) -> Result<()>;
}

impl Gradient for Tensor {
    fn read(&self, body: &mut dyn FnMut(Elements<'_>) -> Result<()>) -> Result<()> {
        let tensor = self.contiguous()?;
        let (storage, layout) = tensor.storage_and_layout();
        let Some((start, end)) = layout.contiguous_offsets() else {
            bail!("a gradient is not contiguous")
        };
        match &*storage {
            Storage::Cpu(CpuStorage::F32(values)) => body(Elements::F32(&values[start..end])),
            Storage::Cpu(CpuStorage::F64(values)) => body(Elements::F64(&values[start..end])),
            _ => bail!("a gradient is neither f32 nor f64 on the CPU"),
        }
    }
}
