//! The neural viewpoint selector.

use serde::{Deserialize, Serialize};

use crate::error::{SelectError, require_some};
use crate::evaluator::Evaluator;
use crate::problem::{Problem, Selector};
use crate::reinforce::{PolicyTraining, Trainer};
use crate::selection::Selection;

/// NVS (section "Viewpoint Selector Framework"): M selector vectors over N views, trained by
/// REINFORCE on drawn sets; the arg-max of each at the end, which need not be the best of the sets
/// that were drawn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Nvs {
    /// Sets asked for in all, repeats and the picks' own included. Default 20,000. With 1, nothing
    /// is learned.
    pub evaluations: u64,
    /// How the selector vectors are trained.
    pub policy: PolicyTraining,
}

impl Default for Nvs {
    fn default() -> Self {
        Self {
            evaluations: 20_000,
            policy: PolicyTraining::default(),
        }
    }
}

impl Selector for Nvs {
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError> {
        require_some("evaluations", self.evaluations)?;
        self.policy.check()?;
        let mut evaluator = Evaluator::new(problem);
        let mut trainer = Trainer::new(self.policy, problem);
        // One is kept for the picks.
        let budget = self.evaluations - 1;
        while evaluator.asked() < budget {
            let left = budget - evaluator.asked();
            let sets = trainer.sample(left);
            let losses = evaluator.losses(sets.as_sets())?;
            let share = left as f64 / budget as f64;
            trainer.learn(sets.as_sets(), &losses, None, share);
        }
        evaluator.finish(trainer.policy.arg_max())
    }
}
