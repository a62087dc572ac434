//! Named tensors of a network, and the files they are read from.
//!
//! ```
//! use candle_core::{Device, Tensor};
//! use sps_models::weights::Weights;
//!
//! let bias = Tensor::new(&[0.5_f32, -1.0], &Device::Cpu)?;
//! let weights = Weights::from_tensors("by hand", [("head.bias".to_owned(), bias)])?;
//!
//! // Written as safetensors; `Weights::read` takes that and PyTorch's files from a path.
//! let again = Weights::from_bytes("a copy", &weights.to_bytes()?)?;
//! assert_eq!(again.get("head.bias")?.to_vec1::<f32>()?, [0.5, -1.0]);
//! let error = again.get("head.weight").unwrap_err();
//! assert_eq!(error.to_string(), r#"a copy: tensor "head.weight" is missing"#);
//! # Ok::<(), sps_models::Error>(())
//! ```

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::Path;

use candle_core::{DType, Device, Tensor};

use crate::differentiable::with_values;
pub use sps_kernels::TensorSpec;
pub use sps_weights::{RawTensor, Storage, WeightsError, WeightsErrorKind};

/// The tensors of a network by name, f32 and finite.
#[derive(Debug, Clone)]
pub struct Weights {
    origin: String,
    tensors: BTreeMap<String, Tensor>,
}

impl Weights {
    /// Reads a weights file; elements of f16, bf16 and f64 become f32.
    ///
    /// The content tells the format: safetensors, or a dictionary of tensors as PyTorch's
    /// `torch.save` writes it, in the zip format of today or in the stream of versions before
    /// 1.6. A pickle is read by an allow list and runs nothing: an opcode or a global that builds
    /// no tensor is refused by name.
    ///
    /// # Errors
    /// When the file cannot be read, is of no such format, holds elements of another type, or
    /// holds a value that is not finite as f32.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, WeightsError> {
        let origin = path.as_ref().display().to_string();
        let bytes = std::fs::read(path).map_err(|error| WeightsError::new(&origin, error.into()));
        Self::from_bytes(&origin, &bytes?)
    }

    /// Reads the content of a weights file; `origin` names it in errors.
    ///
    /// # Errors
    /// As [`Weights::read`].
    pub fn from_bytes(origin: &str, bytes: &[u8]) -> Result<Self, WeightsError> {
        let tensors = sps_weights::read(bytes).map_err(|kind| WeightsError::new(origin, kind))?;
        Self::from_raw(origin, tensors)
    }

    /// The tensors as a safetensors file, f32; the same tensors give the same bytes.
    ///
    /// # Errors
    /// When a tensor's values cannot be had from its device.
    pub fn to_bytes(&self) -> Result<Vec<u8>, WeightsError> {
        self.to_bytes_as(Storage::F32, None)
    }

    /// The tensors as a safetensors file with numbers kept in the given way, with a note (its name
    /// and text) in the file's metadata.
    ///
    /// # Errors
    /// When a tensor's values cannot be had from its device, or one is not finite: it could not be read
    /// back.
    pub fn to_bytes_as(
        &self,
        storage: Storage,
        note: Option<(&str, &str)>,
    ) -> Result<Vec<u8>, WeightsError> {
        let error = |kind| WeightsError::new(&self.origin, kind);
        let raw = |(name, tensor)| Ok((name, raw_tensor(name, tensor)?));
        let raw = self.iter().map(raw).collect::<Result<Vec<_>, _>>();
        sps_weights::write(raw.map_err(error)?, storage, note).map_err(error)
    }

    /// A note that [`Weights::to_bytes_as`] put into a file; `origin` names the file in errors.
    ///
    /// # Errors
    /// When it is no safetensors file or has no note of this name.
    pub fn note(origin: &str, bytes: &[u8], name: &str) -> Result<String, WeightsError> {
        sps_weights::note(bytes, name).map_err(|kind| WeightsError::new(origin, kind))
    }

    /// The tensors whose names begin with `prefix`, without it.
    #[cfg(feature = "heads")]
    pub(crate) fn part(&self, prefix: &str) -> Self {
        let tensors = self.iter().filter_map(|(name, tensor)| {
            let rest = name.strip_prefix(prefix)?;
            Some((rest.to_owned(), tensor.clone()))
        });
        Self::sharing(&self.origin, tensors)
    }

    /// Takes tensors that are in memory already; `origin` names them in errors.
    ///
    /// # Errors
    /// When a tensor is no floating-point tensor or a value is not finite as f32.
    pub fn from_tensors(
        origin: &str,
        tensors: impl IntoIterator<Item = (String, Tensor)>,
    ) -> Result<Self, WeightsError> {
        let raw = tensors.into_iter().map(|(name, tensor)| {
            let tensor = raw_tensor(&name, &tensor)?;
            Ok((name, tensor))
        });
        let raw = raw.collect::<Result<Vec<_>, _>>();
        Self::from_raw(origin, raw.map_err(|kind| WeightsError::new(origin, kind))?)
    }

    /// Takes tensors by name, as `origin` (a file, a seed) has them; refuses a value that is not finite.
    pub(crate) fn from_raw(
        origin: &str,
        tensors: impl IntoIterator<Item = (String, RawTensor)>,
    ) -> Result<Self, WeightsError> {
        let tensors = tensors.into_iter().map(|(name, raw)| {
            raw.check(&name)?;
            let tensor = Tensor::from_vec(raw.values, raw.shape, &Device::Cpu);
            let tensor = tensor.map_err(|error| not_taken(&name, &error))?;
            Ok((name, tensor))
        });
        let tensors = tensors.collect::<Result<Vec<_>, _>>();
        let tensors = tensors.map_err(|kind| WeightsError::new(origin, kind))?;
        Ok(Self::sharing(origin, tensors))
    }

    /// Takes tensors as they are, with the memory that others share.
    pub(crate) fn sharing(
        origin: &str,
        tensors: impl IntoIterator<Item = (String, Tensor)>,
    ) -> Self {
        Self {
            origin: origin.to_owned(),
            tensors: tensors.into_iter().collect(),
        }
    }

    /// Puts another tensor in the place of one of this name.
    pub(crate) fn replace(&mut self, name: &str, tensor: Tensor) {
        self.tensors.insert(name.to_owned(), tensor);
    }

    /// Takes a tensor out.
    pub(crate) fn remove(&mut self, name: &str) -> Option<Tensor> {
        self.tensors.remove(name)
    }

    /// The file, or what else the tensors came from.
    pub fn origin(&self) -> &str {
        &self.origin
    }

    /// The tensors, in the order of their names.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        let tensors = self.tensors.iter();
        tensors.map(|(name, tensor)| (name.as_str(), tensor))
    }

    /// With other names for those tensors that `name` has one for, unless another has it already.
    pub(crate) fn renamed(self, name: impl Fn(&str) -> Option<String>) -> Self {
        let renamed = |(old, tensor): (&String, &Tensor)| {
            let new = name(old).filter(|new| !self.tensors.contains_key(new));
            (new.unwrap_or_else(|| old.clone()), tensor.clone())
        };
        Self::sharing(&self.origin, self.tensors.iter().map(renamed))
    }

    /// Keeps what `network` needs, having checked every name and shape.
    ///
    /// `passes` names tensors that a file may hold beside those of the network (a classifier's
    /// last layer); they are dropped.
    pub(crate) fn fit(
        mut self,
        network: &str,
        specs: &[TensorSpec],
        passes: impl Fn(&str) -> bool,
    ) -> Result<Self, WeightsError> {
        let mut kept = BTreeMap::new();
        for TensorSpec { name, shape } in specs {
            let Some(tensor) = self.remove(name) else {
                return Err(self.error(name, format!("of shape {shape:?} is missing")));
            };
            if tensor.dims() != shape {
                let what = format!("has shape {:?}, expected {shape:?}", tensor.dims());
                return Err(self.error(name, what));
            }
            kept.insert(name.clone(), tensor);
        }
        if let Some((name, tensor)) = self.tensors.iter().find(|(name, _)| !passes(name)) {
            let what = format!("of shape {:?} has no place in {network}", tensor.dims());
            return Err(self.error(name, what));
        }
        self.tensors = kept;
        Ok(self)
    }

    /// A tensor by its name, f32.
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn get(&self, name: &str) -> Result<&Tensor, WeightsError> {
        let missing = || self.error(name, "is missing");
        self.tensors.get(name).ok_or_else(missing)
    }

    fn error(&self, tensor: &str, what: impl Display) -> WeightsError {
        WeightsError::new(&self.origin, WeightsErrorKind::tensor(tensor, what))
    }
}

impl sps_kernels::Tensors for Weights {
    fn with(&self, name: &str, work: &mut dyn FnMut(&[f32])) -> sps_kernels::Result<()> {
        let failed = sps_kernels::Error::Tensor;
        let found = self.get(name).map_err(|error| failed(error.into()))?;
        let values = |values: &[f32]| {
            work(values);
            Ok(())
        };
        with_values(found, values).map_err(|error| failed(error.into()))
    }
}

fn raw_tensor(name: &str, tensor: &Tensor) -> Result<RawTensor, WeightsErrorKind> {
    if !tensor.dtype().is_float() {
        let found = tensor.dtype().as_str();
        let what = format!("has elements of type {found}, expected f16, bf16, f32 or f64");
        return Err(WeightsErrorKind::tensor(name, what));
    }
    let values = tensor.to_dtype(DType::F32);
    let values = values.and_then(|tensor| tensor.flatten_all()?.to_vec1());
    Ok(RawTensor {
        shape: tensor.dims().to_vec(),
        values: values.map_err(|error| not_taken(name, &error))?,
    })
}

fn not_taken(name: &str, error: &candle_core::Error) -> WeightsErrorKind {
    WeightsErrorKind::tensor(name, format_args!("cannot be taken: {error}"))
}
