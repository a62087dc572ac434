//! What makes estimates.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use serde_json::{Value, json};
use sps_estimator::{Regression, Stacked};
use sps_models::heads::Head;
use sps_regress::AnyRegressor;

use super::looks::{Problem, refuse};
use super::schema::{Config, MethodConfig, MethodKind};
use crate::run::Estimates;

#[derive(Clone, Debug)]
pub(crate) enum Estimator {
    /// Fitted to embeddings.
    Fitted(Box<Regression>),
    /// The mean of the training readings.
    Mean,
    /// The mean of those of the same material.
    LabelMean,
    /// Another system, whose estimates are in a file.
    Given(Given),
}

#[derive(Clone, Debug)]
pub(crate) struct Given {
    pub file: PathBuf,
    /// What it holds; none before it has been read and checked against the data.
    pub estimates: Option<Arc<Estimates>>,
}

impl Given {
    pub(crate) fn estimates(&self) -> Result<&Estimates> {
        let read = self.estimates.as_deref();
        read.with_context(|| format!("{} has not been read", self.file.display()))
    }
}

impl Estimator {
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Fitted(regression) => regression.kind(),
            Self::Mean => MethodKind::Mean.name(),
            Self::LabelMean => MethodKind::LabelMean.name(),
            Self::Given(_) => MethodKind::Predictions.name(),
        }
    }

    pub(crate) fn regression(&self) -> Option<&Regression> {
        match self {
            Self::Fitted(regression) => Some(regression),
            _ => None,
        }
    }

    pub(crate) fn file(&self) -> Option<&Path> {
        match self {
            Self::Given(given) => Some(&given.file),
            _ => None,
        }
    }

    /// All that an estimate depends on beside the data.
    pub(crate) fn settings(&self) -> Result<Value> {
        Ok(match self {
            Self::Fitted(regression) => regression.settings()?,
            Self::Mean | Self::LabelMean => self.kind().into(),
            // Not the path: an edited file is scored anew, and one that was moved is not.
            Self::Given(given) => {
                json!({ "kind": self.kind(), "content": given.estimates()?.content() })
            }
        })
    }

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

    pub(crate) fn with(
        &self,
        change: impl FnOnce(&Regression) -> sps_estimator::Result<Regression>,
    ) -> sps_estimator::Result<Self> {
        Ok(match self {
            Self::Fitted(regression) => Self::Fitted(Box::new(change(regression)?)),
            other => other.clone(),
        })
    }
}

pub(super) fn of(config: &Config, method: &MethodConfig) -> Result<Estimator, Problem> {
    let (id, kind) = (&method.id, method.kind);
    if kind != MethodKind::Stacked && !method.members.is_empty() {
        return refuse("members", "need a method of the kind `stacked`");
    }
    let fitted = match (kind, &method.file) {
        (MethodKind::Predictions, Some(file)) => {
            let (file, estimates) = (file.clone(), None);
            return Ok(Estimator::Given(Given { file, estimates }));
        }
        (MethodKind::Predictions, None) => {
            let why = format!("is missing: method `{id}` needs a CSV of its estimates");
            return refuse("file", why);
        }
        (kind, Some(_)) => {
            let kind = kind.name();
            let why = format!("needs a method of the kind `predictions`, and `{id}` is `{kind}`");
            return refuse("file", why);
        }
        (MethodKind::Mean, None) => return Ok(Estimator::Mean),
        (MethodKind::LabelMean, None) => return Ok(Estimator::LabelMean),
        (MethodKind::Stacked, None) if method.members.is_empty() => {
            return refuse("members", "lists none to stack");
        }
        (MethodKind::Stacked, None) if method.folds < 2 => {
            return refuse("folds", "must be at least 2");
        }
        (MethodKind::Stacked, None) => {
            let members = method.members.iter();
            let members = members.map(|&kind| single(config, method, kind));
            Regression::Stacked(Stacked {
                members: members.collect::<Result<_, _>>()?,
                folds: method.folds,
            })
        }
        (kind, None) => single(config, method, kind)?,
    };
    Ok(Estimator::Fitted(Box::new(fitted)))
}

fn single(config: &Config, method: &MethodConfig, kind: MethodKind) -> Result<Regression, Problem> {
    Ok(match kind {
        MethodKind::Head => {
            let head = Head::new(method.head.clone());
            Regression::Head(head.map_err(|error| ("head", error.to_string()))?)
        }
        MethodKind::Rows(kind) => {
            let regressor = AnyRegressor::new(kind, &config.regressors());
            Regression::Rows(regressor.map_err(|error| ("kind", error.to_string()))?)
        }
        kind => return refuse("members", format!("`{}` cannot be stacked", kind.name())),
    })
}
