//! Intervals from one half of the held-out units, judged on the other.

use std::collections::BTreeMap;

use sps_dataset::{Surface, Units};
use sps_estimator::radius;
use sps_experiment::predictions::Prediction;
use sps_metrics::{ConformalError, Level};

/// The share of truths that intervals hold, at each of `levels` for which there are units enough; mean
/// over all estimates of one method.
pub(super) fn held(predictions: &[&Prediction], levels: &[Level]) -> Vec<(Level, f64)> {
    let mut trials: BTreeMap<(&str, usize), Vec<&Prediction>> = BTreeMap::new();
    for prediction in predictions {
        let trial = (prediction.property.as_str(), prediction.rerun);
        trials.entry(trial).or_default().push(prediction);
    }
    let trials: Vec<Trial> = trials.values().map(|trial| Trial::of(trial)).collect();
    let count = predictions.len() as f64;
    let share = |&level: &Level| {
        let held = trials.iter().map(|trial| trial.held(level));
        let held = held.sum::<Result<usize, ConformalError>>().ok()?;
        Some((level, held as f64 / count))
    };
    levels.iter().filter_map(share).collect()
}

struct Trial {
    units: Units,
    /// Of every other unit, and of the rest: the number of the estimate, and how far it is off, in
    /// halves of its own interval where it has one.
    halves: [Vec<(usize, f64)>; 2],
}

impl Trial {
    fn of(predictions: &[&Prediction]) -> Self {
        let surface = |prediction: &&Prediction| Surface {
            id: prediction.surface.clone(),
            material: String::new(),
            group: prediction.group.clone(),
        };
        let surfaces: Vec<Surface> = predictions.iter().map(surface).collect();
        let units = Units::of(&surfaces);
        let off = predictions.iter().map(|prediction| {
            let off = (prediction.estimate - prediction.truth).abs();
            match prediction.interval() {
                Some([low, high]) if off > 0.0 => 2.0 * off / (high - low),
                _ => off,
            }
        });
        let (even, odd) = off
            .enumerate()
            .partition(|(at, _)| units.of_surface()[*at].is_multiple_of(2));
        Self {
            units,
            halves: [even, odd],
        }
    }

    /// How many truths are held, each half by intervals that the other calibrates.
    fn held(&self, level: Level) -> Result<usize, ConformalError> {
        let [even, odd] = &self.halves;
        let counts = [(even, odd), (odd, even)].map(|(calibration, judged)| {
            let radius = radius(&self.units, calibration, level)?;
            Ok(judged.iter().filter(|(_, off)| *off <= radius).count())
        });
        counts.into_iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nine surfaces whose estimates are off by 1 to 9.
    fn predictions(group: fn(usize) -> String) -> Vec<Prediction> {
        let of = |off: usize| Prediction {
            property: "fRS".to_owned(),
            surface: format!("s{off}"),
            truth: 10.0,
            estimate: 10.0 + off as f64,
            group: group(off),
            ..Prediction::default()
        };
        (1..=9).map(of).collect()
    }

    fn share(predictions: &[Prediction], level: f64) -> Option<f64> {
        let predictions: Vec<&Prediction> = predictions.iter().collect();
        let held = held(&predictions, &[Level::new(level).unwrap()]);
        held.first().map(|(_, share)| *share)
    }

    /// Halves are 1, 3, 5, 7, 9 and 2, 4, 6, 8. At 0.5 the radius is the third of five, 5, which
    /// holds two of the others; and the third of four, 6, which holds three.
    #[test]
    fn each_half_is_judged_by_the_other() {
        let all = predictions(|_| String::new());
        assert_eq!(share(&all, 0.5), Some(5.0 / 9.0));
        // Four surfaces promise 4 / 5 and no more.
        assert_eq!(share(&all, 0.9), None);
    }

    /// A group counts once, however many surfaces it has: two groups and two promise 2 / 3.
    #[test]
    fn groups_stay_whole() {
        let all = predictions(|off| format!("g{}", off % 4));
        assert!(share(&all, 0.6).is_some());
        assert_eq!(share(&all, 0.7), None);
    }

    /// Off by as many halves as all others, whatever that is.
    #[test]
    fn an_own_interval_is_the_unit() {
        let mut all = predictions(|_| String::new());
        for prediction in &mut all {
            let off = prediction.estimate - prediction.truth;
            prediction.low = Some(prediction.estimate - off);
            prediction.high = Some(prediction.estimate + off);
        }
        assert_eq!(share(&all, 0.1), Some(1.0));
    }

    /// Right, with intervals that are points.
    #[test]
    fn an_interval_without_width_holds_what_is_right() {
        let mut all = predictions(|_| String::new());
        for prediction in &mut all {
            prediction.estimate = prediction.truth;
            (prediction.low, prediction.high) = (Some(10.0), Some(10.0));
        }
        assert_eq!(share(&all, 0.5), Some(1.0));
    }
}
