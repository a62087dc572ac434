//! What is said of a surface, and the size at which its photographs are looked at: the same for every
//! command that answers.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use serde::Serialize;
use sps_estimator::{Answer, Estimator, Network, Scale};

/// An answer as JSON, with the surface and its photographs.
#[derive(Serialize)]
pub(crate) struct Line<'a> {
    pub surface: &'a str,
    pub images: &'a [PathBuf],
    #[serde(flatten)]
    pub said: Said<'a>,
}

/// An answer as JSON.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Said<'a> {
    level: f64,
    #[serde(flatten)]
    answer: &'a Answer,
    /// Whether the photographs are unlike those that the model was fitted on.
    pub unfamiliar: bool,
    no_familiar: Option<&'a str>,
}

impl<'a> Said<'a> {
    /// Photographs are unfamiliar whose p-value is at most `unfamiliar`.
    pub(crate) fn new(model: &'a Estimator, answer: &'a Answer, unfamiliar: f64) -> Self {
        Self {
            level: model.fitted().level().get(),
            answer,
            unfamiliar: answer.familiar.is_some_and(|p| p <= unfamiliar),
            no_familiar: model.fitted().no_familiar(),
        }
    }
}

/// The size that photographs are brought to where their shorter side is to have `resize` pixels, where
/// they are to `keep` theirs, or where neither is asked for.
pub(crate) fn scale(model: &Estimator, resize: Option<u64>, keep: bool) -> Result<Scale> {
    let asked = match (resize, keep) {
        (Some(pixels), _) => Scale::ShorterSide(pixels as usize),
        (None, true) => Scale::Keep,
        (None, false) => Scale::OfModel,
    };
    match model.embedder().resize() {
        Some(own) if asked != Scale::OfModel => {
            bail!("the model itself brings the shorter side of every photograph to {own} pixels")
        }
        _ => Ok(asked),
    }
}

/// Refuses a model that was fitted on embeddings from a file.
pub(crate) fn check_photographs(model: &Estimator) -> Result<()> {
    ensure!(
        !matches!(model.embedder().network(), Network::Precomputed(_)),
        "found photographs, expected their embeddings: the model was fitted on embeddings that were computed \
         elsewhere; `predict MODEL --embeddings FILE` takes them"
    );
    Ok(())
}

/// A probability that a user types.
pub(crate) fn probability(text: &str) -> Result<f64> {
    let value = text.parse().ok();
    let value = value.filter(|value| (0.0..=1.0).contains(value));
    value.context("expected a number between 0 and 1")
}
