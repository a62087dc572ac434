use crate::data::Embeddings;
use crate::error::Result;
use crate::plan::Trial;
use crate::regressor::{Estimates, FittedRegressor};

/// Fitted models of one kind, one for each trial of a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted<M>(pub(crate) Vec<M>);

/// A kind of models: what [`FittedRegressor`] asks of each, or of all together.
pub trait FittedModel: Clone + Send + Sync + 'static {
    const KIND: &'static str;

    fn trial(&self) -> &Trial;

    fn estimate(models: &[Self], embeddings: &Embeddings) -> Result<Vec<Vec<f64>>>;

    fn multiply_adds(models: &[Self]) -> u64;

    fn to_bytes(models: &[Self]) -> Result<Vec<u8>>;

    fn from_bytes(bytes: &[u8]) -> Result<Vec<Self>>;
}

impl<M: FittedModel> Fitted<M> {
    /// The models, in the order of the plan.
    pub fn models(&self) -> &[M] {
        &self.0
    }

    /// Reads what [`FittedRegressor::to_bytes`] gave.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Self> {
        M::from_bytes(bytes).map(Self)
    }
}

impl<M: FittedModel> FittedRegressor for Fitted<M> {
    fn trials(&self) -> Vec<&Trial> {
        self.0.iter().map(M::trial).collect()
    }

    fn predict(&self, embeddings: &Embeddings) -> Result<Vec<Estimates>> {
        let values = M::estimate(&self.0, embeddings)?;
        let models = self.0.iter().zip(values);
        let estimates = models.map(|(model, values)| Estimates {
            property: model.trial().property.clone(),
            rerun: model.trial().rerun,
            values,
        });
        Ok(estimates.collect())
    }

    fn filtered(&self, keep: &dyn Fn(&Trial) -> bool) -> Box<dyn FittedRegressor> {
        let kept = self.0.iter().filter(|model| keep(model.trial()));
        Box::new(Self(kept.cloned().collect()))
    }

    fn multiply_adds(&self) -> u64 {
        M::multiply_adds(&self.0)
    }

    fn kind(&self) -> &'static str {
        M::KIND
    }

    fn to_bytes(&self) -> Result<Vec<u8>> {
        M::to_bytes(&self.0)
    }
}
