//! Looking at one view after the other, until the estimate is sure enough.
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

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use anyhow::{Context, Result};
use sps_models::heads::{Plan, Rerun, TrainingData, Trial, Views};
use sps_models::{FittedRegressor, Readings};

use sps_models::ridge::{Ridge, RidgeConfig};

use super::fit::{Judge, each, fit, measured};
use super::trials::TrialSpec;
use super::{Encodings, conformal};
use crate::config::{Adaptive, Experiment};
use crate::journal::{Outcome, Stop};
use crate::progress::Progress;

/// Parts of the surfaces fitted to, of which each is estimated by the others.
const FOLDS: usize = 3;
/// The least expected error, as a share of the mean residual: a regression of residuals may say
/// zero, or less.
const LEAST_ERROR: f64 = 0.25;

/// The trials of a method that stops when it is sure.
pub(super) struct Walking<'a> {
    pub experiment: &'a Experiment,
    pub judge: Judge<'a>,
    pub adaptive: &'a Adaptive,
    pub encodings: &'a Encodings,
    pub trials: &'a [&'a TrialSpec],
}

impl Walking<'_> {
    /// The outcome of each trial.
    pub(super) fn outcomes(&self) -> Result<Vec<Outcome>> {
        let begun = Instant::now();
        let most = self
            .trials
            .iter()
            .map(|trial| trial.views.shown().len())
            .max();
        let most = most.unwrap_or(0);
        let progress = Progress::new(&self.judge.method.label, most);
        let mut walks = vec![Walks::default(); self.trials.len()];
        for views in 1..=most {
            for (walks, step) in walks.iter_mut().zip(self.step(views)?) {
                walks.push(step);
            }
            progress.advance(1);
        }
        let of_trial = self.trials.iter().zip(&walks);
        let outcomes = of_trial.map(|(trial, walks)| self.outcome(trial, walks));
        let mut outcomes = outcomes.collect::<Result<Vec<_>>>()?;
        let seconds = begun.elapsed().as_secs_f64() / outcomes.len().max(1) as f64;
        for outcome in &mut outcomes {
            outcome.train_seconds = seconds;
        }
        Ok(outcomes)
    }

    /// What each trial makes of its first `views` views.
    fn step(&self, views: usize) -> Result<Vec<FirstViews>> {
        let fitted = self.estimators(views)?;
        let tables = self.judge.tables;
        let mut residuals = vec![vec![None; self.trials.len()]; tables.pool()];
        let mut steps = Vec::new();
        for (at, (trial, models)) in self.trials.iter().zip(fitted.chunks(FOLDS + 1)).enumerate() {
            let parts = self.parts(trial.rerun)?;
            let mut sum = 0.0;
            let mut count = 0;
            for (model, held) in models.iter().zip(&parts.folds) {
                let held = measured(tables, trial, held)?;
                let surfaces: Vec<usize> = held.iter().map(|(surface, _)| *surface).collect();
                let estimates = self.values(model.as_ref(), trial, views, &surfaces)?;
                for (surface, truth) in held {
                    let residual = (truth - estimates[&surface]).abs();
                    residuals[surface][at] = Some(residual);
                    sum += residual;
                    count += 1;
                }
            }
            let last = models.last().context("no estimator")?;
            steps.push(FirstViews {
                estimates: self.values(last.as_ref(), trial, views, &self.walked(trial)?)?,
                errors: BTreeMap::new(),
                least: LEAST_ERROR * sum / f64::from(count.max(1)),
            });
        }
        let errors = self.errors(views, &residuals)?;
        for ((trial, step), model) in self.trials.iter().zip(&mut steps).zip(errors) {
            step.errors = self.values(model.as_ref(), trial, views, &self.walked(trial)?)?;
        }
        Ok(steps)
    }

    /// The surfaces whose walk is asked for: those that calibrate, and those held out.
    fn walked(&self, trial: &TrialSpec) -> Result<Vec<usize>> {
        let split = &self.judge.splits.all[trial.rerun];
        let mut surfaces = self.parts(trial.rerun)?.calibration;
        surfaces.extend(self.judge.method.scored_on(&split.validation));
        Ok(surfaces)
    }

    /// What a model says of each of the surfaces from the trial's first views.
    fn values(
        &self,
        model: &dyn FittedRegressor,
        trial: &TrialSpec,
        views: usize,
        surfaces: &[usize],
    ) -> Result<BTreeMap<usize, f64>> {
        let embeddings = self
            .encodings
            .select(surfaces, &trial.views.shown()[..views])?;
        let estimates = model.predict(&embeddings)?;
        let values = estimates.into_iter().next().context("no estimate")?.values;
        Ok(surfaces.iter().copied().zip(values).collect())
    }

    /// For each trial an estimator without each fold, and one with all.
    fn estimators(&self, views: usize) -> Result<Vec<Box<dyn FittedRegressor>>> {
        let mut plan = Plan {
            seed: self.experiment.seed,
            reruns: Vec::new(),
            trials: Vec::new(),
        };
        for rerun in self.reruns() {
            let Parts { folds, .. } = self.parts(rerun)?;
            for fold in 0..=FOLDS {
                let others = folds.iter().enumerate().filter(|(at, _)| *at != fold);
                plan.reruns.push(Rerun {
                    number: number(rerun, fold),
                    training: others.flat_map(|(_, part)| part).copied().collect(),
                    validation: Vec::new(),
                });
            }
        }
        for trial in self.trials {
            plan.trials.extend((0..=FOLDS).map(|fold| Trial {
                property: trial.property.to_string(),
                rerun: number(trial.rerun, fold),
                views: Views::Fixed(trial.views.shown()[..views].to_vec()),
            }));
        }
        let method = self.judge.method.with_views(views)?;
        let data = (self.judge.tables, &self.judge.splits.units);
        Ok(each(fit(&method, data, &plan, &())?.models()))
    }

    /// For each trial a regression of its residuals, `(surfaces, trials)`.
    fn errors(
        &self,
        views: usize,
        residuals: &[Vec<Option<f64>>],
    ) -> Result<Vec<Box<dyn FittedRegressor>>> {
        let names: Vec<String> = (0..self.trials.len()).map(|at| at.to_string()).collect();
        let rerun = |rerun| {
            Ok(Rerun {
                number: rerun as u64,
                training: self.parts(rerun)?.folds.concat(),
                validation: Vec::new(),
            })
        };
        let trials = self.trials.iter().zip(&names).map(|(trial, name)| Trial {
            property: name.clone(),
            rerun: trial.rerun as u64,
            views: Views::Fixed(trial.views.shown()[..views].to_vec()),
        });
        let plan = Plan {
            seed: self.experiment.seed,
            reruns: self
                .reruns()
                .into_iter()
                .map(rerun)
                .collect::<Result<_>>()?,
            trials: trials.collect(),
        };
        let data = TrainingData {
            readings: &Readings::new(names, residuals)?,
            ..self.judge.tables.training_data(&self.judge.splits.units)
        };
        let ridges = Ridge::new(RidgeConfig::default())?.train(&data, &plan)?;
        Ok(each(&ridges))
    }

    fn reruns(&self) -> BTreeSet<usize> {
        self.trials.iter().map(|trial| trial.rerun).collect()
    }

    /// The training surfaces of a rerun, by what they are used for; units stay whole.
    fn parts(&self, rerun: usize) -> Result<Parts> {
        let (share, seed) = (self.adaptive.calibration, self.experiment.seed);
        let (calibration, folds) = self.judge.splits.to_walk(rerun, share, FOLDS, seed)?;
        Ok(Parts { calibration, folds })
    }

    fn outcome(&self, trial: &TrialSpec, walks: &Walks) -> Result<Outcome> {
        let judge = &self.judge;
        let calibration = self.parts(trial.rerun)?.calibration;
        let calibration = measured(judge.tables, trial, &calibration)?;
        let scores = calibration
            .iter()
            .map(|&(surface, truth)| Ok((surface, walks.of(surface)?.score(truth))));
        let scores: Vec<(usize, f64)> = scores.collect::<Result<_>>()?;
        let quantile = conformal::radius(&judge.splits.units, &scores, self.adaptive.level)
            .with_context(|| format!("{}: adaptive.calibration", trial.property))?;
        let split = &judge.splits.all[trial.rerun];
        let deviation = deviation(&measured(judge.tables, trial, &split.train)?);
        let held_out = judge.held_out(trial)?;
        let stops = held_out.surfaces.iter().map(|&surface| {
            let walk = walks.of(surface)?;
            Ok(walk.stop(quantile, self.adaptive.width, deviation))
        });
        let stops = stops.collect::<Result<Vec<(f64, Stop)>>>()?;
        let (estimates, stops) = stops.into_iter().unzip();
        let mut outcome = judge.outcome(trial, held_out, estimates);
        outcome.stops = stops;
        Ok(outcome)
    }
}

/// The training surfaces of a rerun.
struct Parts {
    /// Those that say how wide the intervals are.
    calibration: Vec<usize>,
    /// Those that the regressions are fitted to.
    folds: Vec<Vec<usize>>,
}

/// A number for each rerun and fold; the last fold leaves nothing out.
fn number(rerun: usize, fold: usize) -> u64 {
    (rerun * (FOLDS + 1) + fold) as u64
}

/// The standard deviation of readings; 1 where they do not differ.
fn deviation(readings: &[(usize, f64)]) -> f64 {
    let count = readings.len().max(1) as f64;
    let mean = readings.iter().map(|(_, value)| value).sum::<f64>() / count;
    let squares = readings.iter().map(|(_, value)| (value - mean).powi(2));
    let deviation = (squares.sum::<f64>() / count).sqrt();
    if deviation > 0.0 { deviation } else { 1.0 }
}

/// What so many views say of the surfaces that are walked.
struct FirstViews {
    estimates: BTreeMap<usize, f64>,
    errors: BTreeMap<usize, f64>,
    /// What an expected error is at least.
    least: f64,
}

/// The walks of all surfaces, a step for each view.
#[derive(Clone, Default)]
struct Walks(BTreeMap<usize, Walk>);

impl Walks {
    fn push(&mut self, step: FirstViews) {
        let least = step.least.max(f64::MIN_POSITIVE);
        for ((surface, estimate), error) in step.estimates.into_iter().zip(step.errors.values()) {
            let walk = self.0.entry(surface).or_default();
            walk.0.push((estimate, error.max(least)));
        }
    }

    fn of(&self, surface: usize) -> Result<&Walk> {
        self.0
            .get(&surface)
            .context("a surface that was not walked")
    }
}

/// The estimates of one surface and the errors to expect of them, from one view on.
#[derive(Clone, Default)]
struct Walk(Vec<(f64, f64)>);

impl Walk {
    /// The largest residual in units of the error expected of it.
    fn score(&self, truth: f64) -> f64 {
        let scores = self.0.iter();
        let scores = scores.map(|&(estimate, error)| (truth - estimate).abs() / error);
        scores.fold(0.0, f64::max)
    }

    /// The estimate at the first number of views whose interval is at most `width` deviations wide,
    /// or at the last.
    fn stop(&self, quantile: f64, width: f64, deviation: f64) -> (f64, Stop) {
        let relative = |error: f64| 2.0 * quantile * error / deviation;
        let narrow = self
            .0
            .iter()
            .position(|&(_, error)| relative(error) <= width);
        let at = narrow.unwrap_or(self.0.len().saturating_sub(1));
        let (estimate, error) = self.0.get(at).copied().unwrap_or((f64::NAN, f64::NAN));
        let stop = Stop {
            views: at + 1,
            low: estimate - quantile * error,
            high: estimate + quantile * error,
            width: relative(error),
        };
        (estimate, stop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};
    use sps_metrics::{Level, SplitConformal};

    #[test]
    fn looking_ends_at_the_first_interval_that_is_narrow_enough() {
        // Widths of 2 * 3 * error / 10: 2.4, 1.8, 0.6 and 1.2 deviations.
        let walk = Walk(vec![(50.0, 4.0), (52.0, 3.0), (53.0, 1.0), (54.0, 2.0)]);
        let stop = |width| walk.stop(3.0, width, 10.0);
        let (estimate, first) = stop(2.4);
        assert_eq!((estimate, first.views), (50.0, 1));
        assert_eq!((first.low, first.high), (38.0, 62.0));
        assert_eq!(stop(2.0).1.views, 2);
        assert_eq!(stop(1.0).1.views, 3);
        // Never narrow enough: all views.
        let (estimate, last) = stop(0.1);
        assert_eq!((estimate, last.views), (54.0, 4));
        assert!((last.width - 1.2).abs() < 1e-12);
    }

    #[test]
    fn the_score_is_the_largest_residual_in_units_of_its_error() {
        let walk = Walk(vec![(50.0, 4.0), (52.0, 3.0), (60.0, 1.0)]);
        assert_eq!(walk.score(58.0), 2.0); // 8 / 4, 6 / 3, 2 / 1
        assert_eq!(walk.score(62.0), 10.0 / 3.0);
    }

    /// Surfaces that differ in how hard they are, and get easier view by view.
    fn planted(random: &mut ChaCha8Rng) -> (f64, Walk) {
        let mut uniform = || (f64::from(random.next_u32()) + 0.5) / 4_294_967_296.0;
        let hard = 0.5 + 2.0 * uniform();
        let truth = 40.0 + 20.0 * uniform();
        let steps = (1..=6).map(|views| {
            let error = hard / f64::from(views).sqrt();
            let normal: f64 = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
            (truth + error * normal, error)
        });
        (truth, Walk(steps.collect()))
    }

    #[test]
    fn intervals_hold_at_the_promised_rate_wherever_one_stops() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let scores: Vec<f64> = (0..999)
            .map(|_| planted(&mut random))
            .map(|(truth, walk)| walk.score(truth))
            .collect();
        let quantile = SplitConformal::from_residuals(&scores, Level::P90).unwrap();
        let (mut held, mut views) = ([0, 0], [0; 6]);
        for _ in 0..4000 {
            let (truth, walk) = planted(&mut random);
            let (_, stop) = walk.stop(quantile.radius(), 4.0, 1.0);
            held[0] += usize::from((stop.low..=stop.high).contains(&truth));
            views[stop.views - 1] += 1;
            // Whoever stops where it is worst.
            held[1] += usize::from(walk.score(truth) <= quantile.radius());
        }
        assert!(held[0] >= held[1]);
        // 0.9, with a standard error of 0.01 from the calibration and 0.005 from the count.
        assert!((held[1] as f64 / 4000.0 - 0.9).abs() < 0.035, "{held:?}");
        // Easy surfaces take fewer views.
        assert!(views[0] > 0 && views[5] > 0 && views[2] > 0, "{views:?}");
    }
}
