//! The outcome of one trial, as it is scored: that of one split, or those of all folds of a rerun.

use std::collections::HashSet;

use sps_metrics::{Metric, Outcome, Samples, Scored, TrainingMean, Undefined};

use super::Kind;
use crate::journal::{self, Stop};

/// Estimates of one property in one rerun, beside what was measured.
///
/// The folds of a rerun are scored together, each about the mean of its own training part: a fold
/// may hold surfaces of one value alone, and then has no R² that means anything. Folds whose
/// training failed have no estimates, and the others are scored without them.
#[derive(Clone)]
pub(crate) struct Judged<'a> {
    /// All of them, those that failed too.
    pub folds: Vec<&'a journal::Outcome>,
    /// How many of them are scored.
    scored: usize,
    surfaces: Vec<String>,
    truth: Vec<f64>,
    estimate: Vec<f64>,
    /// Truth, estimate and training mean that R² is computed from.
    about_training: About,
}

/// What R² is about.
#[derive(Clone, Copy)]
pub(super) enum Reference {
    /// The mean of the training part.
    Training,
    /// That of the surfaces held out.
    HeldOut,
}

/// Values with the mean that they are judged about.
#[derive(Clone)]
struct About {
    truth: Vec<f64>,
    estimate: Vec<f64>,
    mean: f64,
}

impl<'a> Judged<'a> {
    /// `None` where there is no fold.
    pub(crate) fn of(all: &[&'a journal::Outcome]) -> Option<Self> {
        all.first()?;
        let folds = all.iter().copied().filter(|fold| fold.failed.is_none());
        let folds: Vec<_> = folds.collect();
        let (less_mean, mean) = match folds.as_slice() {
            [one] => (false, one.training_mean),
            _ => (true, 0.0),
        };
        let values = |of: fn(&journal::Outcome) -> &Vec<f64>, less_mean: bool| -> Vec<f64> {
            let values = folds.iter().flat_map(|fold| {
                let mean = if less_mean { fold.training_mean } else { 0.0 };
                of(fold).iter().map(move |value| value - mean)
            });
            values.collect()
        };
        let surfaces = folds.iter().flat_map(|fold| fold.surfaces.iter().cloned());
        Some(Self {
            folds: all.to_vec(),
            scored: folds.len(),
            surfaces: surfaces.collect(),
            truth: values(|fold| &fold.truth, false),
            estimate: values(|fold| &fold.estimate, false),
            about_training: About {
                truth: values(|fold| &fold.truth, less_mean),
                estimate: values(|fold| &fold.estimate, less_mean),
                mean,
            },
        })
    }

    /// Whether there is nothing to score, because all training failed.
    pub(super) fn is_empty(&self) -> bool {
        self.scored == 0
    }

    pub(crate) fn surfaces(&self) -> &[String] {
        &self.surfaces
    }

    pub(super) fn truth(&self) -> &[f64] {
        &self.truth
    }

    pub(super) fn stops(&self) -> impl Iterator<Item = Stop> + '_ {
        self.folds.iter().flat_map(|fold| &fold.stops).copied()
    }

    pub(super) fn samples(&self) -> Samples<'_> {
        Samples {
            truth: &self.truth,
            estimate: &self.estimate,
        }
    }

    /// R² is about the mean of the training part.
    pub(super) fn score(&self, kind: Kind) -> Outcome {
        match kind {
            Kind::R2 => self.r2_metric()?.score(self.r2_samples()),
            kind => kind.metric()?.score(self.samples()),
        }
    }

    pub(super) fn has_r2(&self) -> bool {
        !self.is_empty() && self.score(Kind::R2).is_ok()
    }

    fn r2_metric(&self) -> Result<Metric, Undefined> {
        Ok(Metric::R2(TrainingMean::new(self.about_training.mean)?))
    }

    fn r2_samples(&self) -> Samples<'_> {
        Samples {
            truth: &self.about_training.truth,
            estimate: &self.about_training.estimate,
        }
    }

    /// As R² of a rerun, about the mean of the training part or that of the surfaces held out;
    /// `units` are those of its surfaces.
    pub(super) fn scored<'o>(
        &'o self,
        about: Reference,
        units: &'o [usize],
        rerun: usize,
    ) -> Result<Scored<'o>, Undefined> {
        let (metric, samples) = match about {
            Reference::Training => (self.r2_metric()?, self.r2_samples()),
            Reference::HeldOut => (Metric::R2OwnMean, self.samples()),
        };
        Ok(Scored {
            metric,
            samples,
            units: Some(units),
            rerun,
        })
    }

    /// Both on the surfaces that both have, in the same order.
    pub(super) fn common<'o>(&'o self, other: &'o Self) -> [Judged<'o>; 2] {
        if self.surfaces == other.surfaces {
            return [self.clone(), other.clone()];
        }
        let mine: HashSet<&String> = self.surfaces.iter().collect();
        let theirs: HashSet<&String> = other.surfaces.iter().collect();
        [self.among(&theirs), other.among(&mine)]
    }

    fn among(&self, names: &HashSet<&String>) -> Judged<'_> {
        let kept = self.surfaces.iter().enumerate();
        let kept = kept.filter(|(_, name)| names.contains(name));
        let kept: Vec<usize> = kept.map(|(at, _)| at).collect();
        let some = |values: &[f64]| kept.iter().map(|&at| values[at]).collect();
        Judged {
            folds: self.folds.clone(),
            scored: self.scored,
            surfaces: kept.iter().map(|&at| self.surfaces[at].clone()).collect(),
            truth: some(&self.truth),
            estimate: some(&self.estimate),
            about_training: About {
                truth: some(&self.about_training.truth),
                estimate: some(&self.about_training.estimate),
                mean: self.about_training.mean,
            },
        }
    }
}
