//! Where a network's numbers come from.

use std::collections::BTreeMap;

use crate::error::{Error, Result};
use crate::network::Network;

/// The name and shape of one tensor of a network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TensorSpec {
    /// The name in a weights file.
    pub name: String,
    /// The shape.
    pub shape: Vec<usize>,
}

impl TensorSpec {
    /// Takes both.
    pub fn new(name: impl Into<String>, shape: &[usize]) -> Self {
        Self {
            name: name.into(),
            shape: shape.to_vec(),
        }
    }
}

/// The tensors of a network by name; [`Network::specs`](crate::network::Network::specs) lists what it needs.
pub trait Tensors: std::fmt::Debug + Send + Sync {
    /// Calls `work` once with the numbers of a tensor, row-major.
    ///
    /// # Errors
    /// When there is none of this name.
    fn with(&self, name: &str, work: &mut dyn FnMut(&[f32])) -> Result<()>;
}

impl Tensors for BTreeMap<String, Vec<f32>> {
    fn with(&self, name: &str, work: &mut dyn FnMut(&[f32])) -> Result<()> {
        let values = self
            .get(name)
            .ok_or_else(|| Error::input("tensors", format_args!("no {name:?}"), "one"))?;
        work(values);
        Ok(())
    }
}

/// What `work` makes of the numbers of a tensor.
pub(crate) fn with_values<T>(
    tensors: &dyn Tensors,
    name: &str,
    work: impl FnOnce(&[f32]) -> T,
) -> Result<T> {
    let (mut work, mut outcome) = (Some(work), None);
    tensors.with(name, &mut |values| {
        outcome = work.take().map(|work| work(values));
    })?;
    outcome.ok_or_else(|| Error::input("tensors", format_args!("no {name:?}"), "one"))
}

/// Refuses tensors that are not those of a network.
pub(crate) fn check(network: &Network, tensors: &dyn Tensors) -> Result<()> {
    for TensorSpec { name, shape } in network.specs() {
        let found = with_values(tensors, &name, <[f32]>::len)?;
        if found != shape.iter().product::<usize>() {
            let found = format_args!("{found} numbers in {name:?}");
            return Err(Error::input("tensors", found, format_args!("{shape:?}")));
        }
    }
    Ok(())
}
