//! REINFORCE on a policy, one batch of sets at a time.

use serde::{Deserialize, Serialize};

use crate::adam::Adam;
use crate::error::{SelectError, require, require_not_negative, require_positive, require_some};
use crate::policy::Policy;
use crate::problem::Problem;
use crate::sets::{SetList, Sets};
use crate::vector::{add, mean};

/// What is subtracted from the reward (minus the loss) to make the advantage.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Baseline {
    /// Nothing: plain REINFORCE, the paper's form.
    None,
    /// A moving mean of the batches before: `mean = decay * mean + (1 - decay) * batch mean`, which
    /// starts at the first batch's mean.
    MovingMean {
        /// From 0 (the batch before alone) to below 1.
        decay: f64,
    },
    /// For each set the mean of the other sets of its batch (Kool, van Hoof and Welling 2019). A
    /// batch of one has advantage 0.
    LeaveOneOut,
}

/// How the selector vectors are trained.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct PolicyTraining {
    /// Sets drawn per step. Default 50.
    pub batch: usize,
    /// Adam's learning rate. Default 0.2: a view's odds change by up to a fifth per step, 400 steps
    /// in 20,000 evaluations. The paper gives none.
    pub learning_rate: f64,
    /// What is subtracted from the reward. Default leave-one-out, which has no setting.
    pub baseline: Baseline,
    /// Divides advantages by a moving root mean square of theirs, so that neither `entropy_weight`
    /// nor what the policy makes of a batch depends on the unit of the loss. Default true.
    pub standardise: bool,
    /// Weight of the policy's entropy in the objective, at the start; it falls linearly to 0 at the
    /// end of the budget. Default 0.3: of 0 to 0.8, 0.2 to 0.4 found the most planted triples; with
    /// less, the policy settles before it has seen enough, with more, the budget ends before it has
    /// settled.
    pub entropy_weight: f64,
}

impl Default for PolicyTraining {
    fn default() -> Self {
        Self {
            batch: 50,
            learning_rate: 0.2,
            baseline: Baseline::LeaveOneOut,
            standardise: true,
            entropy_weight: 0.3,
        }
    }
}

impl PolicyTraining {
    /// The paper's plain form: no baseline, no scaling, no entropy.
    #[must_use]
    pub fn plain(self) -> Self {
        Self {
            baseline: Baseline::None,
            standardise: false,
            entropy_weight: 0.0,
            ..self
        }
    }

    pub(crate) fn check(&self) -> Result<(), SelectError> {
        require_some("batch", self.batch)?;
        require_positive("learning-rate", self.learning_rate)?;
        require_not_negative("entropy-weight", self.entropy_weight)?;
        if let Baseline::MovingMean { decay } = self.baseline {
            let fits = (0.0..1.0).contains(&decay);
            require(fits, "decay", decay, "a number from 0 to below 1")?;
        }
        Ok(())
    }
}

/// A policy on its way.
pub(crate) struct Trainer {
    settings: PolicyTraining,
    pub(crate) policy: Policy,
    adam: Adam,
    moving_mean: Option<f64>,
    moving_square: Option<f64>,
    seed: u64,
    steps: u64,
}

/// Of the moving mean square that advantages are divided by: some ten batches long.
const SQUARE_DECAY: f64 = 0.9;

impl Trainer {
    /// The settings are checked.
    pub(crate) fn new(settings: PolicyTraining, problem: &Problem<'_>) -> Self {
        let policy = Policy::uniform(problem);
        Self {
            settings,
            adam: Adam::new(policy.logits.len(), settings.learning_rate),
            policy,
            moving_mean: None,
            moving_square: None,
            seed: problem.seed_value(),
            steps: 0,
        }
    }

    /// The sets of the next step, at most `most` of them.
    pub(crate) fn sample(&mut self, most: u64) -> SetList {
        let count = (self.settings.batch as u64).min(most) as usize;
        self.steps += 1;
        self.policy.sample(self.seed, self.steps, count)
    }

    /// One step: up along the REINFORCE gradient and the entropy's, down along `extra`, a gradient
    /// of a loss with respect to z. `left` is the share of the budget that is left, from 1 to 0.
    pub(crate) fn learn(
        &mut self,
        sets: Sets<'_>,
        losses: &[f64],
        extra: Option<&[f64]>,
        left: f64,
    ) {
        let advantages = self.advantages(losses);
        let mut down = self.policy.reinforce_gradient(sets, &advantages);
        for gradient in &mut down {
            *gradient = -*gradient;
        }
        let weight = self.settings.entropy_weight * left;
        if weight > 0.0 {
            add(&mut down, -weight, &self.policy.entropy_gradient());
        }
        if let Some(extra) = extra {
            add(&mut down, 1.0, extra);
        }
        self.adam.descend(&mut self.policy.logits, &down, 1.0);
    }

    fn advantages(&mut self, losses: &[f64]) -> Vec<f64> {
        let batch_mean = mean(losses);
        let mut advantages: Vec<f64> = match self.settings.baseline {
            Baseline::None => losses.iter().map(|loss| -loss).collect(),
            Baseline::MovingMean { decay } => {
                let baseline = self.moving_mean.unwrap_or(batch_mean);
                self.moving_mean = Some(baseline + (1.0 - decay) * (batch_mean - baseline));
                losses.iter().map(|loss| baseline - loss).collect()
            }
            Baseline::LeaveOneOut => {
                // The mean of the others, less the loss: (sum - loss) / (B - 1) - loss.
                let scale = losses.len() as f64 / losses.len().saturating_sub(1).max(1) as f64;
                let advantage = |loss| scale * (batch_mean - loss);
                losses.iter().map(advantage).collect()
            }
        };
        if self.settings.standardise {
            self.standardise(&mut advantages);
        }
        advantages
    }

    fn standardise(&mut self, advantages: &mut [f64]) {
        let squares = advantages.iter().map(|advantage| advantage * advantage);
        let square = squares.sum::<f64>() / advantages.len() as f64;
        let moving = self.moving_square.map_or(square, |moving| {
            SQUARE_DECAY * moving + (1.0 - SQUARE_DECAY) * square
        });
        self.moving_square = Some(moving);
        // Nothing to divide where all were 0 so far.
        if moving > 0.0 {
            let scale = moving.sqrt().recip();
            for advantage in advantages {
                *advantage *= scale;
            }
        }
    }
}
