//! The outcome of one trial, as it is scored: that of one split, or those of all folds of a rerun.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};

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
    rerun: usize,
    /// All of them, those that failed too.
    pub folds: &'a [journal::Outcome],
    /// How many of them are scored.
    scored: usize,
    /// By their numbers.
    surfaces: Vec<usize>,
    /// The unit of each surface, by its number: what is alike.
    units: Vec<usize>,
    values: Values,
    /// What R² about the training mean is computed from, with that mean.
    about_training: (Values, f64),
    /// R² about the training mean.
    r2: Outcome,
}

/// The numbers of a surface and of its unit, by the surface's name.
pub(crate) type Numbers<'a> = HashMap<&'a str, [usize; 2]>;

/// What R² is about.
#[derive(Clone, Copy)]
pub(super) enum Reference {
    /// The mean of the training part.
    Training,
    /// That of the surfaces held out.
    HeldOut,
}

/// Of each surface.
#[derive(Clone)]
struct Values {
    truth: Vec<f64>,
    estimate: Vec<f64>,
}

impl Values {
    /// The values of folds, less a number for each fold.
    fn of(folds: &[&journal::Outcome], less: fn(&journal::Outcome) -> f64) -> Self {
        let values = |of: fn(&journal::Outcome) -> &Vec<f64>| {
            let folds = folds.iter();
            let values = folds.flat_map(|&fold| of(fold).iter().map(move |x| x - less(fold)));
            values.collect()
        };
        Self {
            truth: values(|fold| &fold.truth),
            estimate: values(|fold| &fold.estimate),
        }
    }

    fn at(&self, kept: &[usize]) -> Self {
        let some = |values: &[f64]| kept.iter().map(|&at| values[at]).collect();
        Self {
            truth: some(&self.truth),
            estimate: some(&self.estimate),
        }
    }

    fn samples(&self) -> Samples<'_> {
        Samples {
            truth: &self.truth,
            estimate: &self.estimate,
        }
    }
}

impl<'a> Judged<'a> {
    /// Of all folds of a rerun.
    pub(crate) fn of(rerun: usize, folds: &'a [journal::Outcome], numbers: &Numbers<'_>) -> Self {
        let scored = folds.iter().filter(|fold| fold.failed.is_none());
        let scored: Vec<_> = scored.collect();
        let values = Values::of(&scored, |_| 0.0);
        let about_training = match scored.as_slice() {
            [one] => (values.clone(), one.training_mean),
            _ => (Values::of(&scored, |fold| fold.training_mean), 0.0),
        };
        let names = scored.iter().flat_map(|fold| &fold.surfaces);
        let numbers = names.map(|name| numbers.get(&name[..]).copied().unwrap_or([usize::MAX; 2]));
        let (surfaces, units) = numbers.map(|[surface, unit]| (surface, unit)).unzip();
        Self {
            rerun,
            folds,
            scored: scored.len(),
            surfaces,
            units,
            values,
            r2: r2(&about_training),
            about_training,
        }
    }

    /// Whether there is nothing to score, because all training failed.
    pub(super) fn is_empty(&self) -> bool {
        self.scored == 0
    }

    pub(super) fn surfaces(&self) -> &[usize] {
        &self.surfaces
    }

    pub(super) fn units(&self) -> &[usize] {
        &self.units
    }

    pub(super) fn stops(&self) -> impl Iterator<Item = Stop> + '_ {
        self.folds.iter().flat_map(|fold| &fold.stops).copied()
    }

    pub(super) fn samples(&self) -> Samples<'_> {
        self.values.samples()
    }

    /// R² is about the mean of the training part.
    pub(super) fn score(&self, kind: Kind) -> Outcome {
        match kind {
            Kind::R2 => self.r2.clone(),
            kind => kind.metric()?.score(self.samples()),
        }
    }

    pub(super) fn has_r2(&self) -> bool {
        !self.is_empty() && self.r2.is_ok()
    }

    /// As R² of a rerun, about the mean of the training part or that of the surfaces held out.
    pub(super) fn scored(&self, about: Reference) -> Result<Scored<'_>, Undefined> {
        let (metric, samples) = match about {
            Reference::Training => about_training(&self.about_training)?,
            Reference::HeldOut => (Metric::R2OwnMean, self.samples()),
        };
        Ok(Scored {
            metric,
            samples,
            units: Some(&self.units),
            rerun: self.rerun,
        })
    }

    /// Both on the surfaces that both have, in the same order.
    pub(super) fn common<'j>(&'j self, other: &'j Self) -> [Cow<'j, Self>; 2] {
        if self.surfaces == other.surfaces {
            return [self, other].map(Cow::Borrowed);
        }
        let both = [(self, other), (other, self)];
        both.map(|(one, other)| Cow::Owned(one.among(&other.surfaces)))
    }

    fn among(&self, surfaces: &[usize]) -> Self {
        let surfaces: HashSet<&usize> = surfaces.iter().collect();
        let kept = (0..self.surfaces.len()).filter(|&at| surfaces.contains(&self.surfaces[at]));
        let kept: Vec<usize> = kept.collect();
        let (values, mean) = &self.about_training;
        let about_training = (values.at(&kept), *mean);
        Self {
            rerun: self.rerun,
            folds: self.folds,
            scored: self.scored,
            surfaces: kept.iter().map(|&at| self.surfaces[at]).collect(),
            units: kept.iter().map(|&at| self.units[at]).collect(),
            values: self.values.at(&kept),
            r2: r2(&about_training),
            about_training,
        }
    }
}

fn r2(values: &(Values, f64)) -> Outcome {
    let (metric, samples) = about_training(values)?;
    metric.score(samples)
}

/// R² as a metric, and what it is computed from.
fn about_training((values, mean): &(Values, f64)) -> Result<(Metric, Samples<'_>), Undefined> {
    Ok((Metric::R2(TrainingMean::new(*mean)?), values.samples()))
}
