//! What selectors found.

use std::collections::BTreeMap;

use anyhow::Result;
use serde::{Deserialize, Serialize};
use sps_dataset::Property;
use sps_viewselect::{Problem, Random, Selection, Selector};

use crate::config::Selected;
use crate::journal::{Record, TrialKey};

/// Points that are kept of a search's curve.
const CURVE_POINTS: usize = 60;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Found {
    pub key: TrialKey,
    /// Picks are indices of the source's views; losses are in units of the variance of the training
    /// readings.
    pub selection: Selection,
    /// Mean loss of random sets; none where no loss was asked for.
    pub random_loss: Option<f64>,
    /// What it took, with its share of the training of the networks that were asked.
    pub seconds: f64,
}

impl Found {
    /// What the selector finds, beside the mean loss of so many random sets.
    pub(super) fn search(
        key: TrialKey,
        selected: &Selected,
        problem: &Problem<'_>,
        random_sets: usize,
    ) -> Result<Self> {
        let random = Random { draws: random_sets };
        let random = random.select(problem)?;
        Ok(Self {
            key,
            selection: thinned(selected.selector.select(problem)?),
            random_loss: random.curve.first().map(|point| point.mean),
            seconds: 0.0,
        })
    }
}

impl Record for Found {
    fn key(&self) -> &TrialKey {
        &self.key
    }
}

#[derive(Default)]
pub(crate) struct Selections(BTreeMap<(String, Property, usize), Found>);

impl Selections {
    pub(super) fn insert(&mut self, method: &str, property: Property, rerun: usize, found: Found) {
        self.0.insert((method.to_owned(), property, rerun), found);
    }

    pub(crate) fn get(&self, method: &str, property: &Property, rerun: usize) -> Option<&Found> {
        self.0.get(&(method.to_owned(), property.clone(), rerun))
    }
}

/// The selection with a curve of few points, the last among them.
fn thinned(mut selection: Selection) -> Selection {
    let count = selection.curve.len();
    let keep = |at: usize| at * CURVE_POINTS / count != (at + 1) * CURVE_POINTS / count;
    let mut at = 0..;
    if count > CURVE_POINTS {
        selection.curve.retain(|_| at.next().is_some_and(keep));
    }
    selection
}
