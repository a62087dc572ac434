//! Fitted regressions as JSON: small enough, and every digit is kept.

use serde::{Deserialize, Serialize};

use super::{Fit, TrainedRidge, TrainedRidges};
use crate::error::{Error, Result};
use crate::plan::Trial;
use crate::regressor::check_finite;

const FORMAT: u32 = 1;

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct File {
    format: u32,
    ridges: Vec<Stored>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Stored {
    trial: Trial,
    penalty: f64,
    intercept: f64,
    weights: Vec<f64>,
}

impl TrainedRidges {
    /// The file's content, JSON; the same regressions give the same bytes.
    ///
    /// # Errors
    ///
    /// A weight that is not finite.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let numbers = |Fit {
                           penalty,
                           intercept,
                           weights,
                       }: &Fit| {
            weights
                .iter()
                .copied()
                .chain([*penalty, *intercept])
                .collect::<Vec<_>>()
        };
        let all = self.ridges.iter().flat_map(|ridge| numbers(&ridge.fit));
        check_finite("ridge regressions", all)?;
        let ridges = self.ridges.iter().map(|ridge| Stored {
            trial: ridge.trial.clone(),
            penalty: ridge.fit.penalty,
            intercept: ridge.fit.intercept,
            weights: ridge.fit.weights.to_vec(),
        });
        let file = File {
            format: FORMAT,
            ridges: ridges.collect(),
        };
        serde_json::to_vec(&file)
            .map_err(|error| Error::input("ridge regressions", error, "finite weights"))
    }

    /// Reads what [`TrainedRidges::to_bytes`] gave.
    ///
    /// # Errors
    ///
    /// Bytes that are not fitted regressions of this format.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let file: File = serde_json::from_slice(bytes)
            .map_err(|error| Error::input("ridge regressions", error, "a file of them"))?;
        if file.format != FORMAT {
            return Err(Error::input(
                "format of ridge regressions",
                file.format,
                FORMAT,
            ));
        }
        let ridges = file.ridges.into_iter().map(|stored| TrainedRidge {
            trial: stored.trial,
            fit: Fit {
                penalty: stored.penalty,
                intercept: stored.intercept,
                weights: stored.weights.into(),
            },
        });
        Ok(Self {
            ridges: ridges.collect(),
        })
    }
}
