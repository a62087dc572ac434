//! Looking at one view after the other, until the estimate is sure enough.
//!
//! `sps_estimator::Step` says what is estimated of a surface's first views, how intervals are made of it
//! and why they hold wherever one stops; here it is asked for all trials of a method at once.

use std::collections::BTreeMap;
use std::time::Instant;

use anyhow::{Context, Result};
use sps_estimator::{Look, Step, radius};

use super::Encodings;
use super::fit::{Judge, measured};
use super::trials::TrialSpec;
use crate::config::{Adaptive, Experiment};
use crate::journal::{Outcome, Stop};
use crate::progress::{Progress, ensure_wanted};

/// Parts of the surfaces fitted to, of which each is estimated by the others.
const FOLDS: usize = 3;

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
            ensure_wanted()?;
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
        let judge = &self.judge;
        let (tables, units) = (judge.tables, &judge.splits.units);
        let look = |trial: &&TrialSpec| {
            Ok(Look {
                property: trial.property.to_string(),
                rerun: trial.rerun as u64,
                views: trial.views.shown(),
                folds: self.parts(trial.rerun)?.folds,
            })
        };
        let looks = self
            .trials
            .iter()
            .map(look)
            .collect::<Result<Vec<Look>>>()?;
        let regression = judge.method.estimator.regression();
        let regression = regression
            .context("a method that looks at nothing")?
            .with_views(views)?;
        let data = tables.training_data(units);
        let step = Step::fit(
            &regression,
            (&data, units),
            self.experiment.seed,
            &looks,
            views,
        )?;
        let trials = self.trials.iter().enumerate();
        let steps = trials.map(|(at, trial)| {
            let walked = self.walked(trial)?;
            let shown = &trial.views.shown()[..views];
            let said = step.says(at, &self.encodings.select(&walked, shown)?)?;
            let said = said.into_iter().map(|said| (said.value, said.error));
            Ok(walked.into_iter().zip(said).collect())
        });
        steps.collect()
    }

    /// The surfaces whose walk is asked for: those that calibrate, and those held out.
    fn walked(&self, trial: &TrialSpec) -> Result<Vec<usize>> {
        let split = &self.judge.splits.all[trial.rerun];
        let mut surfaces = self.parts(trial.rerun)?.calibration;
        surfaces.extend(self.judge.method.scored_on(&split.validation));
        Ok(surfaces)
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
        let quantile = radius(&judge.splits.units, &scores, self.adaptive.level)
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

/// The standard deviation of readings; 1 where they do not differ.
pub(super) fn deviation(readings: &[(usize, f64)]) -> f64 {
    let count = readings.len().max(1) as f64;
    let mean = readings.iter().map(|(_, value)| value).sum::<f64>() / count;
    let squares = readings.iter().map(|(_, value)| (value - mean).powi(2));
    let deviation = (squares.sum::<f64>() / count).sqrt();
    if deviation > 0.0 { deviation } else { 1.0 }
}

/// What so many views say of the surfaces that are walked: an estimate, and the error to expect.
type FirstViews = BTreeMap<usize, (f64, f64)>;

/// The walks of all surfaces, a step for each view.
#[derive(Clone, Default)]
struct Walks(BTreeMap<usize, Walk>);

impl Walks {
    fn push(&mut self, step: FirstViews) {
        for (surface, said) in step {
            self.0.entry(surface).or_default().0.push(said);
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
