//! The value based neural viewpoint selector.

use serde::{Deserialize, Serialize};

use crate::critic::Critic;
use crate::error::{SelectError, require, require_not_negative, require_positive, require_some};
use crate::evaluator::Evaluator;
use crate::problem::{Problem, Selector};
use crate::reinforce::{PolicyTraining, Trainer};
use crate::selection::Selection;
use crate::sets::SetList;
use crate::stream::{Purpose, Stream};
use crate::value_search::lowest_sets;

/// VB-NVS (section "Viewpoint Selector Framework"): beside the selector vectors a value network is
/// trained, which estimates the loss from the joined probability vectors. Its error signal is passed
/// back to the selector vectors, and the set is found by searching it: coordinate descent from
/// several starts and all combinations of the best few views of each slot give a shortlist, whose
/// true losses the network learns before it is searched again.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct VbNvs {
    /// Sets asked for in all, repeats and shortlist included. Default 20,000.
    pub evaluations: u64,
    /// How the selector vectors are trained.
    pub policy: PolicyTraining,
    /// The value network.
    pub value: ValueTraining,
    /// The search for the final set.
    pub search: ValueSearch,
}

/// How the value network is trained, and what it passes on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ValueTraining {
    /// Tanh units. Default 16; the paper says "lightweight" and no more.
    pub hidden: usize,
    /// Adam's learning rate at the start; it falls linearly to 0 at the end of the budget.
    /// Default 0.03.
    pub learning_rate: f64,
    /// Steps of the network per step of the policy. Default 4.
    pub steps: usize,
    /// Sets per step, drawn from all that were evaluated so far. Default 64.
    pub batch: usize,
    /// Weight of the network's gradient beside REINFORCE's, in units of the first batch's spread of
    /// losses. Default 0.1: with 0.5 the policy follows a network that has seen little.
    pub weight: f64,
}

/// How the value network is searched at the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ValueSearch {
    /// Coordinate descents: from the policy's arg-max, the best set so far, and random sets.
    /// Default 16.
    pub starts: usize,
    /// Sets that are gone through with the network: every combination of the best few views of
    /// each slot. Default 2^13: 20 views per slot for M = 3.
    pub combinations: usize,
    /// Of these the best that were not evaluated before, whose loss is evaluated. Default 50.
    pub shortlist: usize,
    /// Searches; after each the network learns the losses of the shortlist. The lowest loss of all
    /// that were evaluated is picked. Default 20.
    pub rounds: u64,
}

impl Default for ValueTraining {
    fn default() -> Self {
        Self {
            hidden: 16,
            learning_rate: 0.03,
            steps: 4,
            batch: 64,
            weight: 0.1,
        }
    }
}

impl Default for ValueSearch {
    fn default() -> Self {
        Self {
            starts: 16,
            combinations: 1 << 13,
            shortlist: 50,
            rounds: 20,
        }
    }
}

impl Default for VbNvs {
    fn default() -> Self {
        Self {
            evaluations: 20_000,
            policy: PolicyTraining::default(),
            value: ValueTraining::default(),
            search: ValueSearch::default(),
        }
    }
}

impl ValueSearch {
    /// The most evaluations that the search may spend.
    fn evaluations(&self) -> u64 {
        self.rounds.saturating_mul(self.shortlist as u64)
    }
}

/// The share of its learning rate that the value network keeps to the end.
const FLOOR: f64 = 0.1;

impl VbNvs {
    fn check(&self) -> Result<(), SelectError> {
        let (value, search) = (self.value, self.search);
        self.policy.check()?;
        require_some("hidden", value.hidden)?;
        require_positive("learning-rate", value.learning_rate)?;
        require_some("steps", value.steps)?;
        require_some("batch", value.batch)?;
        require_not_negative("weight", value.weight)?;

        require(search.starts > 1, "starts", search.starts, "at least 2")?;
        require_some("combinations", search.combinations)?;
        require_some("shortlist", search.shortlist)?;
        require_some("rounds", search.rounds)?;
        let fits = self.evaluations > search.evaluations();
        let expected = "more than `shortlist` times `rounds`";
        require(fits, "evaluations", self.evaluations, expected)
    }
}

impl Selector for VbNvs {
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError> {
        self.check()?;
        let mut evaluator = Evaluator::new(problem);
        let mut trainer = Trainer::new(self.policy, problem);
        let mut critic = Critic::new(self.value, problem);
        let budget = self.evaluations - self.search.evaluations();
        while evaluator.asked() < budget {
            let left = budget - evaluator.asked();
            let share = left as f64 / budget as f64;
            let probabilities = trainer.policy.probabilities();
            let sets = trainer.sample(left);
            let losses = evaluator.losses(sets.as_sets())?;
            let sets = sets.as_sets();
            critic.learn(sets, &losses, Some(&probabilities), share.max(FLOOR));
            let signal = critic.error_signal(&probabilities, problem.views());
            trainer.learn(sets, &losses, Some(&signal), share);
        }
        for round in 0..self.search.rounds {
            let mut starts = SetList::new(problem.picks());
            starts.push(&trainer.policy.arg_max());
            starts.push(&critic.best_set());
            let mut stream = Stream::new(problem.seed_value(), Purpose::ValueStarts, round);
            starts.extend((2..self.search.starts).map(|_| stream.set(problem)));
            let known = |set: &[usize]| evaluator.knows(set);
            let shortlist = lowest_sets(critic.network(), problem, &starts, self.search, known);
            let shortlist = shortlist.as_sets();
            if shortlist.is_empty() {
                break;
            }
            let losses = evaluator.losses(shortlist)?;
            critic.learn(shortlist, &losses, None, FLOOR);
        }
        evaluator.finish(critic.best_set())
    }
}
