//! What makes estimates of embeddings.

use anyhow::Result;
use serde_json::Value;
use sps_estimator::{Regression, Stacked};
use sps_models::heads::{Head, HeadConfig};
use sps_models::kernel_ridge::KernelRidge;
use sps_models::ridge::Ridge;

use super::looks::{Problem, refuse};
use super::schema::{Config, MethodConfig, MethodKind};

#[derive(Clone, Debug)]
pub(crate) enum Estimator {
    /// Fitted to embeddings.
    Fitted(Box<Regression>),
    /// The mean of the training readings.
    Mean,
    /// The mean of those of the same material.
    LabelMean,
}

impl Estimator {
    /// As a config calls it.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Fitted(regression) => regression.kind(),
            Self::Mean => MethodKind::Mean.name(),
            Self::LabelMean => MethodKind::LabelMean.name(),
        }
    }

    /// What is fitted, where anything is.
    pub(crate) fn regression(&self) -> Option<&Regression> {
        match self {
            Self::Fitted(regression) => Some(regression),
            Self::Mean | Self::LabelMean => None,
        }
    }

    /// All that an estimate depends on beside the data.
    pub(crate) fn settings(&self) -> Result<Value> {
        Ok(match self {
            Self::Fitted(regression) => regression.settings()?,
            Self::Mean | Self::LabelMean => self.kind().into(),
        })
    }

    /// The network, where there is one.
    pub(crate) fn head(&self) -> Option<&Head> {
        self.regression().and_then(Regression::head)
    }

    /// What a person should know who gives it so many training surfaces: that it stands on fewer.
    pub(crate) fn thinned(&self, training_surfaces: usize) -> Option<String> {
        let at_most = self.regression()?.at_most()?;
        (training_surfaces > at_most).then(|| {
            format!(
                "kernel ridge regression stands on {at_most} of the {training_surfaces} training \
                 surfaces, drawn at random (`kernel-ridge.at-most`)"
            )
        })
    }

    /// With what is fitted changed.
    pub(super) fn with(
        &self,
        change: impl FnOnce(&Regression) -> sps_estimator::Result<Regression>,
    ) -> sps_estimator::Result<Self> {
        Ok(match self {
            Self::Fitted(regression) => Self::Fitted(Box::new(change(regression)?)),
            other => other.clone(),
        })
    }

    /// With every network changed.
    pub(crate) fn with_heads(
        &self,
        change: &impl Fn(&HeadConfig) -> HeadConfig,
    ) -> sps_estimator::Result<Self> {
        self.with(|regression| regression.with_heads(change))
    }
}

/// What the config of a method says of it.
pub(super) fn of(config: &Config, method: &MethodConfig) -> Result<Estimator, Problem> {
    Ok(match method.kind {
        MethodKind::Mean => Estimator::Mean,
        MethodKind::LabelMean => Estimator::LabelMean,
        _ => Estimator::Fitted(Box::new(regression(config, method)?)),
    })
}

fn regression(config: &Config, method: &MethodConfig) -> Result<Regression, Problem> {
    let stacked = method.kind == MethodKind::Stacked;
    if !stacked && !method.members.is_empty() {
        return refuse("members", "need a method of the kind `stacked`");
    }
    if !stacked {
        return single(config, method, method.kind);
    }
    if method.members.is_empty() {
        return refuse("members", "lists none to stack");
    }
    if method.folds < 2 {
        return refuse("folds", "must be at least 2");
    }
    let member = |&kind: &MethodKind| single(config, method, kind);
    Ok(Regression::Stacked(Stacked {
        members: method
            .members
            .iter()
            .map(member)
            .collect::<Result<_, _>>()?,
        folds: method.folds,
    }))
}

fn single(config: &Config, method: &MethodConfig, kind: MethodKind) -> Result<Regression, Problem> {
    let refused = |field| move |error: sps_models::Error| (field, error.to_string());
    Ok(match kind {
        MethodKind::Head => {
            Regression::Head(Head::new(method.head.clone()).map_err(refused("head"))?)
        }
        MethodKind::Ridge => {
            Regression::Ridge(Ridge::new(config.ridge.clone()).map_err(refused("kind"))?)
        }
        MethodKind::KernelRidge => {
            let ridge = KernelRidge::new(config.kernel_ridge.clone());
            Regression::KernelRidge(ridge.map_err(refused("kind"))?)
        }
        MethodKind::Nearest => Regression::Nearest,
        MethodKind::Mean | MethodKind::LabelMean | MethodKind::Stacked => {
            return refuse("members", format!("`{}` cannot be stacked", kind.name()));
        }
    })
}
