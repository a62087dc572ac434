use crate::data::Embeddings;
use crate::error::Result;
use crate::plan::Trial;
use crate::regressor::{Estimates, FittedRegressor};

/// Fitted models of one kind, one for each trial of a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted<M>(pub(crate) Vec<M>);

/// A kind of models.
pub trait FittedModel: Clone + Send + Sync + 'static {
    /// What [`fitted_from_bytes`](crate::fitted_from_bytes) reads them by.
    const KIND: &'static str;

    /// What the model was fitted for.
    fn trial(&self) -> &Trial;

    /// Each model's estimate for each surface, as [`FittedRegressor::predict`] wants them.
    ///
    /// # Errors
    ///
    /// Embeddings of another width or number of views than were fitted.
    fn estimate(models: &[Self], embeddings: &Embeddings) -> Result<Vec<Vec<f64>>>;

    /// Multiply-adds to estimate one surface from its embeddings, all models together.
    fn multiply_adds(models: &[Self]) -> u64;

    /// The models as the content of a file; the same models give the same bytes.
    ///
    /// # Errors
    ///
    /// A number that is not finite.
    fn to_bytes(models: &[Self]) -> Result<Vec<u8>>;

    /// Reads what [`FittedModel::to_bytes`] gave.
    ///
    /// # Errors
    ///
    /// Bytes that are not models of this kind and format.
    fn from_bytes(bytes: &[u8]) -> Result<Vec<Self>>;
}

impl<M: FittedModel> Fitted<M> {
    /// The models, in the order of the plan.
    pub fn models(&self) -> &[M] {
        &self.0
    }

    /// The models for which `keep` says so.
    #[must_use]
    pub fn filter(&self, keep: impl Fn(&Trial) -> bool) -> Self {
        let kept = self.0.iter().filter(|model| keep(model.trial()));
        Self(kept.cloned().collect())
    }

    /// Reads what [`FittedRegressor::to_bytes`] gave.
    ///
    /// # Errors
    ///
    /// Bytes that are not models of this kind and format.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
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
        Box::new(self.filter(keep))
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
