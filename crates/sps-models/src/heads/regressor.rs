//! Heads beside the regressors of `sps-regress`.

use candle_core::{DType, Tensor};
use sps_regress::{
    DivergedTrial, Embeddings, Estimates, FittedRegressor, OtherKind, Plan, Regressor,
    TrainingData, Trial,
};

use super::{Head, TrainedHead, TrainedHeads};
use crate::error::{Error, Result};

/// Embeddings from a tensor of any floating-point type: `(surfaces, width)` for one view of each
/// surface, or `(surfaces, views, width)`.
///
/// # Errors
/// Another rank or type, and what [`Embeddings::new`] says.
pub fn embeddings_of(tensor: &Tensor) -> Result<Embeddings> {
    let shape = match *tensor.dims() {
        [surfaces, width] => [surfaces, 1, width],
        [surfaces, views, width] => [surfaces, views, width],
        _ => {
            let found = format_args!("shape {:?}", tensor.dims());
            let expected = "(surfaces, width) or (surfaces, views, width)";
            return Err(Error::input("embeddings", found, expected));
        }
    };
    if !tensor.dtype().is_float() {
        let found = format_args!("type {}", tensor.dtype().as_str());
        return Err(Error::input("embeddings", found, "floating point"));
    }
    let values = tensor.to_dtype(DType::F32)?.flatten_all()?.to_vec1()?;
    Ok(Embeddings::new(values, shape)?)
}

const HEADS: OtherKind = OtherKind {
    kind: "heads",
    read: |name, bytes| Ok(Box::new(TrainedHeads::from_bytes(name, bytes)?)),
};

/// [`sps_regress::fitted_from_bytes`], which knows heads too, by themselves and in stacks.
///
/// # Errors
/// A kind that there is not, and bytes that are not models of it.
pub fn fitted_from_bytes(kind: &str, name: &str, bytes: &[u8]) -> Result<Box<dyn FittedRegressor>> {
    Ok(sps_regress::fitted_from_bytes(kind, name, bytes, &[HEADS])?)
}

impl Regressor for Head {
    fn fit(
        &self,
        data: &TrainingData<'_>,
        plan: &Plan,
    ) -> sps_regress::Result<Box<dyn FittedRegressor>> {
        let heads = self.train(data, plan, &())?;
        if let Some(DivergedTrial { trial, reason }) = heads.diverged().first() {
            let found = format!("{}, rerun {}: {reason}", trial.property, trial.rerun);
            return Err(Error::input("training", found, "losses that stay finite").into());
        }
        Ok(Box::new(heads))
    }

    fn needs_validation(&self) -> bool {
        self.config().early_stopping.is_some()
    }
}

impl FittedRegressor for TrainedHeads {
    fn trials(&self) -> Vec<&Trial> {
        self.heads().iter().map(TrainedHead::trial).collect()
    }

    fn predict(&self, embeddings: &Embeddings) -> sps_regress::Result<Vec<Estimates>> {
        Ok(self.predict(embeddings)?)
    }

    fn filtered(&self, keep: &dyn Fn(&Trial) -> bool) -> Box<dyn FittedRegressor> {
        Box::new(self.filter(keep))
    }

    fn multiply_adds(&self) -> u64 {
        let heads = self.heads.iter();
        heads.map(|head| head.multiply_adds(self.config())).sum()
    }

    fn kind(&self) -> &'static str {
        HEADS.kind
    }

    fn to_bytes(&self) -> sps_regress::Result<Vec<u8>> {
        Ok(self.to_bytes()?)
    }

    fn diverged(&self) -> &[DivergedTrial] {
        self.diverged()
    }
}
