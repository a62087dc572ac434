//! Estimates of a surface from its first views, with the error to expect of each.
//!
//! Of a surface's first m views there is an estimate and, by a second regression, the error that
//! such an estimate has: locally weighted split conformal prediction (Lei, G'Sell, Rinaldo,
//! Tibshirani and Wasserman, "Distribution-Free Predictive Inference for Regression", JASA 113,
//! 2018, section 5.2). The second regression learns the absolute residuals of estimators that have
//! not seen the surface. Both are fitted to one part of the training surfaces. For each surface of
//! the other part, the score is the largest residual over m, each divided by the error expected of
//! it; the conformal quantile of the scores times the expected error is the radius of the interval.
//!
//! Because of the largest, the intervals of a new surface hold its truth for all m at once at the
//! promised rate, and so at the m where one stops, however that is decided.

use sps_dataset::Units;
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::{Embeddings, FittedRegressor, Plan, Readings, Rerun, TrainingData, Trial, Views};

use crate::error::{Error, Result};
use crate::regression::Regression;

/// The least expected error, as a share of the mean residual: a regression of residuals may say
/// zero, or less.
const LEAST_ERROR: f64 = 0.25;

/// A property to estimate from the first of some views.
#[derive(Clone, Debug)]
pub(crate) struct Look {
    /// The property.
    pub property: String,
    /// The number of its rerun.
    pub rerun: u64,
    /// The views, in the order in which they are looked at.
    pub views: Vec<usize>,
    /// The surfaces to fit to, in parts of which each is estimated by the others. Where there is but
    /// one, every estimate has the same expected error, 1.
    pub folds: Vec<Vec<usize>>,
}

impl Look {
    /// A number for each rerun and part; the last leaves nothing out.
    fn number(&self, fold: usize) -> Result<u64> {
        if self.folds.len() < 2 {
            return Ok(self.rerun);
        }
        let first = self.rerun.checked_mul(self.folds.len() as u64 + 1);
        first
            .and_then(|first| first.checked_add(fold as u64))
            .ok_or_else(|| Error::input("number of a rerun", self.rerun, "a smaller one"))
    }

    /// A rerun for the parts without each of them, and one for all; for these alone where there is one.
    fn fits(&self) -> impl Iterator<Item = usize> + use<> {
        let parts = self.folds.len();
        (if parts < 2 { parts } else { 0 })..=parts
    }

    fn without(&self, fold: usize) -> Vec<usize> {
        let others = self.folds.iter().enumerate().filter(|(at, _)| *at != fold);
        others.flat_map(|(_, part)| part).copied().collect()
    }

    fn trial(&self, property: String, rerun: u64, views: usize) -> Trial {
        Trial {
            property,
            rerun,
            views: Views::Fixed(self.views[..views].to_vec()),
        }
    }
}

/// An estimate and the error to expect of it, both in the property's measured units; an expected
/// error is above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Expected {
    /// The estimate.
    pub value: f64,
    /// The expected error.
    pub error: f64,
}

/// What is estimated of surfaces from their first so many views.
pub(crate) struct Step {
    /// One for each look, in their order.
    pub(crate) models: Box<dyn FittedRegressor>,
    /// Of their errors; none where all are alike.
    pub(crate) errors: Option<Box<dyn FittedRegressor>>,
    /// What each expected error is at least.
    pub(crate) least: Vec<f64>,
}

impl Step {
    pub(crate) fn fit(
        regression: &Regression,
        (data, units): (&TrainingData<'_>, &Units),
        seed: u64,
        looks: &[Look],
        views: usize,
    ) -> Result<Self> {
        if let Some(few) = looks.iter().find(|look| look.views.len() < views) {
            let found = format!("{} for {}", few.views.len(), few.property);
            return Err(Error::input("views", found, format!("at least {views}")));
        }
        let all = regression.fit(data, units, &estimators(seed, looks, views)?)?;
        let mut residuals = vec![vec![None; looks.len()]; data.embeddings.surfaces()];
        let mut least = Vec::new();
        for (at, look) in looks.iter().enumerate() {
            let mean = residuals_of(look, (at, views), data, all.as_ref(), &mut residuals)?;
            least.push(LEAST_ERROR * mean);
        }
        let whole = looks.iter().map(|look| look.number(look.folds.len()));
        let whole = whole.collect::<Result<Vec<u64>>>()?;
        let models = all.filtered(&|trial| whole.contains(&trial.rerun));
        let errors = if looks.iter().all(|look| look.folds.len() < 2) {
            None
        } else {
            Some(errors(&residuals, data, seed, looks, views)?)
        };
        Ok(Self {
            models,
            errors,
            least,
        })
    }

    /// What every look says of surfaces, where all look at the same views.
    pub(crate) fn predict(&self, embeddings: &Embeddings) -> Result<Vec<Vec<Expected>>> {
        let values = self.models.predict(embeddings)?;
        let errors = self
            .errors
            .as_ref()
            .map(|errors| errors.predict(embeddings));
        let errors = errors.transpose()?;
        let expected = values.into_iter().enumerate().map(|(look, estimates)| {
            let least = self.least[look].max(f64::MIN_POSITIVE);
            let error = |surface: usize| match &errors {
                Some(errors) => errors[look].values[surface].max(least),
                None => 1.0,
            };
            let values = estimates.values.into_iter().enumerate();
            let expected = values.map(|(surface, value)| Expected {
                value,
                error: error(surface),
            });
            expected.collect()
        });
        Ok(expected.collect())
    }
}

/// An estimator of each look that learns from `surfaces`, whatever the look itself learns from.
pub(crate) fn whole(
    regression: &Regression,
    (data, units): (&TrainingData<'_>, &Units),
    seed: u64,
    (looks, surfaces): (&[Look], &[usize]),
    views: usize,
) -> Result<Box<dyn FittedRegressor>> {
    let number = looks.first().map_or(0, |look| look.rerun);
    let trials = looks.iter();
    let trials = trials.map(|look| look.trial(look.property.clone(), number, views));
    let plan = Plan {
        seed,
        reruns: vec![Rerun {
            number,
            training: surfaces.to_vec(),
            validation: Vec::new(),
        }],
        trials: trials.collect(),
    };
    regression.fit(data, units, &plan)
}

/// An estimator of each look without each part of its surfaces, and one with all.
fn estimators(seed: u64, looks: &[Look], views: usize) -> Result<Plan> {
    let mut plan = Plan {
        seed,
        reruns: Vec::new(),
        trials: Vec::new(),
    };
    for look in looks {
        for fold in look.fits() {
            let number = look.number(fold)?;
            if plan.reruns.iter().all(|rerun| rerun.number != number) {
                plan.reruns.push(Rerun {
                    number,
                    training: look.without(fold),
                    validation: Vec::new(),
                });
            }
            let property = look.property.clone();
            plan.trials.push(look.trial(property, number, views));
        }
    }
    Ok(plan)
}

/// Notes the absolute residuals of a look's estimators for the parts that they have not seen, in
/// column `at`; their mean.
fn residuals_of(
    look: &Look,
    (at, views): (usize, usize),
    data: &TrainingData<'_>,
    all: &dyn FittedRegressor,
    residuals: &mut [Vec<Option<f64>>],
) -> Result<f64> {
    let (mut sum, mut count) = (0.0, 0_usize);
    for fold in look.fits().filter(|fold| *fold < look.folds.len()) {
        let number = look.number(fold)?;
        let model =
            all.filtered(&|trial| (trial.rerun, &trial.property) == (number, &look.property));
        let column = data.readings.column(&look.property);
        let reading = |&surface: &usize| Some((surface, data.readings.get(surface, column?)?));
        let read: Vec<(usize, f64)> = look.folds[fold].iter().filter_map(reading).collect();
        let surfaces: Vec<usize> = read.iter().map(|(surface, _)| *surface).collect();
        let embeddings = data.embeddings.select(&surfaces, &look.views[..views])?;
        let estimates = model.predict(&embeddings)?.pop();
        let estimates = estimates
            .map(|estimates| estimates.values)
            .unwrap_or_default();
        for ((surface, truth), estimate) in read.into_iter().zip(estimates) {
            let residual = (truth - estimate).abs();
            residuals[surface][at] = Some(residual);
            sum += residual;
            count += 1;
        }
    }
    Ok(sum / count.max(1) as f64)
}

/// For each look a regression of its residuals, `(surfaces, looks)`.
fn errors(
    residuals: &[Vec<Option<f64>>],
    data: &TrainingData<'_>,
    seed: u64,
    looks: &[Look],
    views: usize,
) -> Result<Box<dyn FittedRegressor>> {
    let names: Vec<String> = (0..looks.len()).map(|at| at.to_string()).collect();
    let mut reruns: Vec<Rerun> = Vec::new();
    for look in looks {
        if reruns.iter().all(|rerun| rerun.number != look.rerun) {
            reruns.push(Rerun {
                number: look.rerun,
                training: look.folds.concat(),
                validation: Vec::new(),
            });
        }
    }
    let trials = looks.iter().zip(&names);
    let trials = trials.map(|(look, name)| look.trial(name.clone(), look.rerun, views));
    let plan = Plan {
        seed,
        reruns,
        trials: trials.collect(),
    };
    let data = TrainingData {
        readings: &Readings::new(names, residuals)?,
        ..*data
    };
    Ok(Box::new(
        Ridge::new(RidgeConfig::default())?.train(&data, &plan)?,
    ))
}
