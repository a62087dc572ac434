//! Why numbers of a row are missing.

use std::fmt::Display;

use sps_metrics::{IntervalError, PropertyMean, ScoreInterval};

use super::{MethodOutcomes, Number};

#[derive(Default)]
pub(super) struct Notes {
    pub lines: Vec<String>,
}

impl Notes {
    pub(super) fn failures(&mut self, method: &MethodOutcomes<'_>) {
        for (property, outcomes) in &method.outcomes {
            for (rerun, judged) in outcomes.iter().enumerate() {
                for reason in judged.folds.iter().filter_map(|fold| fold.failed.as_ref()) {
                    self.add(&format!("{property}, rerun {rerun}, left out"), reason);
                }
            }
        }
    }

    pub(super) fn add(&mut self, what: &str, reason: &dyn Display) {
        self.lines.push(format!("{what}: {reason}"));
    }

    pub(super) fn mean(&mut self, what: &str, mean: PropertyMean) -> Number {
        for (property, reason) in &mean.left_out {
            self.add(&format!("{what}, without {property}"), reason);
        }
        mean.value.ok()
    }

    /// A mean that says nothing unless every property is in it.
    pub(super) fn whole_mean(&mut self, what: &str, mean: PropertyMean) -> Number {
        if mean.is_complete() {
            return self.mean(what, mean);
        }
        let found = mean.properties.len();
        let reason = format!("needs {} properties, {found} have a score", mean.wanted);
        self.add(what, &reason);
        None
    }

    pub(super) fn interval(
        &mut self,
        what: &str,
        interval: Result<ScoreInterval, IntervalError>,
    ) -> Option<[f64; 2]> {
        let found = self.found(what, interval)?;
        Some([found.low, found.high])
    }

    /// One rerun leaves every interval out for the same reason, which is said once.
    pub(super) fn found(
        &mut self,
        what: &str,
        interval: Result<ScoreInterval, IntervalError>,
    ) -> Option<ScoreInterval> {
        let reason = match interval {
            Ok(interval) => return Some(interval),
            Err(reason @ IntervalError::TooFewReruns { .. }) => format!("no intervals: {reason}"),
            Err(reason) => format!("{what}: {reason}"),
        };
        if !self.lines.contains(&reason) {
            self.lines.push(reason);
        }
        None
    }
}
