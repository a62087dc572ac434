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
use sps_regress::ridge::Ridge;
use sps_regress::{FittedRegressor, Plan, Readings, Rerun, TrainingData, Views};

use crate::error::{Error, Result};
use crate::regression::Regression;

/// The least expected error, as a share of the mean residual: a regression of residuals may say
/// zero, or less.
const LEAST_ERROR: f64 = 0.25;

/// What is fitted to estimate properties from the same views.
pub(crate) struct Fit<'a> {
    pub regression: &'a Regression,
    pub data: &'a TrainingData<'a>,
    pub units: &'a Units,
    /// They key every random draw.
    pub seed: u64,
    pub number: u64,
    pub properties: &'a [String],
    pub views: &'a [usize],
}

/// What is fitted to the same views: models, those of their errors where these differ, and the least of
/// each.
pub(crate) struct Step {
    pub models: Box<dyn FittedRegressor>,
    pub errors: Option<Box<dyn FittedRegressor>>,
    pub least: Vec<f64>,
}

impl Fit<'_> {
    /// Estimators that learn from all of these surfaces.
    pub(crate) fn whole(&self, surfaces: &[usize]) -> Result<Box<dyn FittedRegressor>> {
        let plan = self.plan(self.properties, vec![(self.number, surfaces.to_vec())]);
        self.regression.fit(self.data, self.units, &plan)
    }

    /// Estimators, and regressions of their errors on surfaces in parts, of which each is estimated by the
    /// others. Where there is but one part, every estimate has the same expected error, 1.
    pub(crate) fn step(&self, parts: &[Vec<usize>]) -> Result<Step> {
        if parts.len() < 2 {
            return Ok(Step {
                models: self.whole(&parts.concat())?,
                errors: None,
                least: vec![0.0; self.properties.len()],
            });
        }
        // Without each part, and without none.
        let count = parts.len() as u64 + 1;
        let first = self.number.checked_mul(count);
        let first = first.filter(|first| first.checked_add(count).is_some());
        let first = first.ok_or_else(|| Error::input("number", self.number, "a smaller one"))?;
        let without = |part: usize| {
            let others = parts.iter().enumerate().filter(|(at, _)| *at != part);
            let others = others.flat_map(|(_, part)| part).copied();
            (first + part as u64, others.collect())
        };
        let plan = self.plan(self.properties, (0..=parts.len()).map(without).collect());
        let all = self.regression.fit(self.data, self.units, &plan)?;
        let mut residuals =
            vec![vec![None; self.properties.len()]; self.data.embeddings.surfaces()];
        let mut least = Vec::new();
        for (at, property) in self.properties.iter().enumerate() {
            let (mut sum, mut count) = (0.0, 0_usize);
            for (number, part) in (first..).zip(parts) {
                let model =
                    all.filtered(&|trial| (trial.rerun, &trial.property) == (number, property));
                for (surface, residual) in self.residuals(model.as_ref(), property, part)? {
                    residuals[surface][at] = Some(residual);
                    sum += residual;
                    count += 1;
                }
            }
            least.push(LEAST_ERROR * sum / count.max(1) as f64);
        }
        let last = first + parts.len() as u64;
        Ok(Step {
            models: all.filtered(&|trial| trial.rerun == last),
            errors: Some(self.errors(&residuals, parts.concat())?),
            least,
        })
    }

    fn plan(&self, properties: &[String], reruns: Vec<(u64, Vec<usize>)>) -> Plan {
        let reruns = reruns.into_iter();
        let reruns = reruns.map(|(number, training)| Rerun::new(number, training));
        let plan = Plan::each(self.seed, properties, reruns.collect());
        plan.with_views(&Views::Fixed(self.views.to_vec()))
    }

    /// How far a model is off on those of some surfaces that were measured.
    fn residuals(
        &self,
        model: &dyn FittedRegressor,
        property: &str,
        surfaces: &[usize],
    ) -> Result<Vec<(usize, f64)>> {
        let (readings, column) = (self.data.readings, self.data.readings.column(property));
        let reading = |&surface: &usize| Some((surface, readings.get(surface, column?)?));
        let (surfaces, truths): (Vec<usize>, Vec<f64>) =
            surfaces.iter().filter_map(reading).unzip();
        let embeddings = self.data.embeddings.select(&surfaces, self.views)?;
        let estimates = model.predict(&embeddings)?.pop();
        let estimates = estimates.into_iter().flat_map(|estimates| estimates.values);
        let off = truths.iter().zip(estimates);
        let off = off.map(|(truth, estimate)| (truth - estimate).abs());
        Ok(surfaces.into_iter().zip(off).collect())
    }

    /// For each property a regression of its residuals, `(surfaces, properties)`.
    fn errors(
        &self,
        residuals: &[Vec<Option<f64>>],
        surfaces: Vec<usize>,
    ) -> Result<Box<dyn FittedRegressor>> {
        let names = (0..self.properties.len()).map(|at| at.to_string());
        let names: Vec<String> = names.collect();
        let plan = self.plan(&names, vec![(self.number, surfaces)]);
        let data = TrainingData {
            readings: &Readings::new(names, residuals)?,
            ..*self.data
        };
        Ok(Box::new(Ridge::default().train(&data, &plan)?))
    }
}
