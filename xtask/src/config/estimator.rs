//! What makes estimates of embeddings.

use anyhow::Result;
use serde_json::{Value, json};
use sps_models::heads::{Head, HeadConfig, Input};
use sps_models::kernel_ridge::KernelRidge;
use sps_models::ridge::Ridge;

use super::looks::{Problem, refuse};
use super::schema::{Config, MethodConfig, MethodKind};

#[derive(Clone, Debug)]
pub(crate) enum Estimator {
    Head(Head),
    Ridge(Ridge),
    KernelRidge(KernelRidge),
    /// The reading of the nearest neighbour.
    Nearest,
    Stacked(Stacked),
    /// The mean of the training readings.
    Mean,
    /// The mean of those of the same material.
    LabelMean,
}

/// Several estimators, weighed by how well each does out of fold.
#[derive(Clone, Debug)]
pub(crate) struct Stacked {
    pub members: Vec<Estimator>,
    pub folds: usize,
}

impl Estimator {
    /// As a config calls it.
    pub(crate) const fn kind(&self) -> &'static str {
        match self {
            Self::Head(_) => MethodKind::Head.name(),
            Self::Ridge(_) => MethodKind::Ridge.name(),
            Self::KernelRidge(_) => MethodKind::KernelRidge.name(),
            Self::Nearest => MethodKind::Nearest.name(),
            Self::Stacked(_) => MethodKind::Stacked.name(),
            Self::Mean => MethodKind::Mean.name(),
            Self::LabelMean => MethodKind::LabelMean.name(),
        }
    }

    /// All that an estimate depends on beside the data.
    pub(crate) fn settings(&self) -> Result<Value> {
        Ok(match self {
            Self::Head(head) => serde_json::to_value(head.config())?,
            Self::Ridge(ridge) => serde_json::to_value(ridge.config())?,
            Self::KernelRidge(ridge) => serde_json::to_value(ridge.config())?,
            Self::Stacked(stacked) => {
                let members = stacked.members.iter().map(Self::settings);
                let members = members.collect::<Result<Vec<Value>>>()?;
                json!({ "folds": stacked.folds, "members": members })
            }
            Self::Nearest | Self::Mean | Self::LabelMean => self.kind().into(),
        })
    }

    /// The network, where there is one.
    pub(crate) fn head(&self) -> Option<&Head> {
        match self {
            Self::Head(head) => Some(head),
            Self::Stacked(stacked) => stacked.members.iter().find_map(Self::head),
            _ => None,
        }
    }

    /// With every network changed.
    pub(crate) fn with_heads(
        &self,
        change: &impl Fn(&HeadConfig) -> HeadConfig,
    ) -> sps_models::Result<Self> {
        Ok(match self {
            Self::Head(head) => Self::Head(Head::new(change(head.config()))?),
            Self::Stacked(stacked) => {
                let members = stacked.members.iter();
                let members = members.map(|member| member.with_heads(change));
                Self::Stacked(Stacked {
                    members: members.collect::<Result<_, _>>()?,
                    folds: stacked.folds,
                })
            }
            other => other.clone(),
        })
    }

    /// With networks that take this input.
    pub(super) fn with_input(&self, input: &Input) -> sps_models::Result<Self> {
        self.with_heads(&|config| HeadConfig {
            input: input.clone(),
            ..config.clone()
        })
    }
}

/// What the config of a method says of it.
pub(super) fn of(config: &Config, method: &MethodConfig) -> Result<Estimator, Problem> {
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
    let member = |&kind: &MethodKind| match kind {
        kind if kind.looks() => single(config, method, kind),
        kind => refuse("members", format!("`{}` cannot be stacked", kind.name())),
    };
    Ok(Estimator::Stacked(Stacked {
        members: method
            .members
            .iter()
            .map(member)
            .collect::<Result<_, _>>()?,
        folds: method.folds,
    }))
}

fn single(config: &Config, method: &MethodConfig, kind: MethodKind) -> Result<Estimator, Problem> {
    let refused = |field| move |error: sps_models::Error| (field, error.to_string());
    Ok(match kind {
        MethodKind::Head => {
            Estimator::Head(Head::new(method.head.clone()).map_err(refused("head"))?)
        }
        MethodKind::Ridge => {
            Estimator::Ridge(Ridge::new(config.ridge.clone()).map_err(refused("kind"))?)
        }
        MethodKind::KernelRidge => {
            let ridge = KernelRidge::new(config.kernel_ridge.clone());
            Estimator::KernelRidge(ridge.map_err(refused("kind"))?)
        }
        MethodKind::Nearest => Estimator::Nearest,
        MethodKind::Mean => Estimator::Mean,
        MethodKind::LabelMean => Estimator::LabelMean,
        MethodKind::Stacked => return refuse("members", "`stacked` cannot be stacked"),
    })
}
