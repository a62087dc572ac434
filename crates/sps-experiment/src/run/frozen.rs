//! Stage 1 of the choice of views: estimators that are trained on random sets of views and frozen,
//! and their loss of a set.
//!
//! With folds, there is an estimator for each part of the training surfaces, trained on the other
//! parts: a set of views is not rewarded for surfaces that its estimator has learned by heart.

use anyhow::{Context, Result};
use sps_dataset::{Property, Split};
use sps_estimator::early_stopped;
use sps_models::heads::{FusionLoss, Head, Observer, TrainedHeads};
use sps_regress::{TrainingData, Trial, Views};
use sps_viewselect::{LossError, SetLoss, Sets};

use super::trials::plan;
use super::{Encodings, Splits, Tables};
use crate::config::Experiment;
use crate::progress::Progress;

pub(crate) struct Folds<'a> {
    pub experiment: &'a Experiment,
    pub encodings: &'a Encodings,
    pub splits: &'a Splits,
}

impl Folds<'_> {
    /// Estimators of these properties and reruns, for all folds.
    pub(super) fn train<'a>(
        &self,
        head: &Head,
        wanted: impl Iterator<Item = (&'a Property, usize)>,
    ) -> Result<TrainedHeads> {
        let of_wanted = |(property, rerun)| {
            let folds = 0..self.experiment.selection_folds;
            folds.map(move |fold| self.trial(property, rerun, fold))
        };
        let trials: Vec<Trial> = wanted.flat_map(of_wanted).collect();
        let observer = TrainingProgress(Progress::new("estimators for random views", trials.len()));
        // Each rerun has as many parts as there are folds, so that they are numbered as in `trial`.
        let parts = (0..self.splits.all.len()).map(|rerun| self.parts(rerun));
        let parts = parts.collect::<Result<Vec<_>>>()?.concat();
        let plan = plan(self.experiment.seed, &parts, trials.into_iter());
        let plan = early_stopped(head, &self.splits.units, plan).context("head.early-stopping")?;
        Ok(head.train(&self.training_data(), &plan, &observer)?)
    }

    /// The loss of sets for one property and rerun.
    pub(super) fn loss(
        &self,
        estimators: &TrainedHeads,
        property: &Property,
        rerun: usize,
    ) -> Result<FrozenLoss> {
        let (tables, data) = (self.tables(), self.training_data());
        let mut folds = Vec::new();
        for (fold, part) in self.parts(rerun)?.into_iter().enumerate() {
            let held = part.validation;
            // A part without a reading says nothing.
            if !tables.measured(property, &held).is_empty() {
                let trial = self.trial(property, rerun, fold);
                folds.push(estimators.fusion_loss(&trial, &data, &held)?);
            }
        }
        Ok(FrozenLoss(folds))
    }

    fn training_data(&self) -> TrainingData<'_> {
        self.tables().training_data(&self.splits.units)
    }

    pub(super) fn tables(&self) -> &Tables {
        &self.encodings.stage.tables
    }

    fn trial(&self, property: &Property, rerun: usize, fold: usize) -> Trial {
        Trial {
            property: property.to_string(),
            rerun: (rerun * self.experiment.selection_folds + fold) as u64,
            views: Views::Random,
        }
    }

    /// The training surfaces of a rerun that each fold's estimator is trained on, and those that its
    /// loss is measured on. Units stay whole.
    fn parts(&self, rerun: usize) -> Result<Vec<Split>> {
        let (folds, seed) = (self.experiment.selection_folds, self.experiment.seed);
        self.splits.to_select(rerun, folds, seed)
    }
}

/// The loss of frozen estimators, as selectors ask for it: the mean over the surfaces of all.
pub(super) struct FrozenLoss(Vec<FusionLoss>);

impl SetLoss for FrozenLoss {
    fn views(&self) -> usize {
        self.0.first().map_or(0, FusionLoss::views)
    }

    fn picks(&self) -> usize {
        self.0.first().map_or(0, FusionLoss::slots)
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        let surfaces: usize = self.0.iter().map(FusionLoss::surfaces).sum();
        let mut of_fold = vec![0.0; losses.len()];
        losses.fill(0.0);
        for fold in &self.0 {
            fold.losses(sets.as_flat(), &mut of_fold)?;
            let share = fold.surfaces() as f64 / surfaces as f64;
            for (sum, loss) in losses.iter_mut().zip(&of_fold) {
                *sum += share * loss;
            }
        }
        Ok(())
    }
}

/// Counts estimators as they are trained.
struct TrainingProgress(Progress);

impl Observer for TrainingProgress {
    fn finished(&self, heads: &TrainedHeads) {
        self.0.advance(heads.heads().len());
    }
}
