//! The value based neural viewpoint selector.

use crate::baselines::best_of;
use crate::error::{SelectError, require};
use crate::evaluator::{Evaluator, mean};
use crate::problem::{Problem, Selector};
use crate::reinforce::{PolicyTraining, Trainer};
use crate::selection::Selection;
use crate::sets::{SetList, Sets};
use crate::softmax;
use crate::stream::{Purpose, Stream};
use crate::value::ValueNetwork;
use crate::value_search::{Limits, lowest_sets};

/// VB-NVS (section "Viewpoint Selector Framework"): beside the selector vectors a value network is
/// trained, which estimates the loss from the joined probability vectors. Its error signal is passed
/// back to the selector vectors, and the set is found by searching it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(
    feature = "serde",
    serde(default, deny_unknown_fields, rename_all = "kebab-case")
)]
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
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(
    feature = "serde",
    serde(default, deny_unknown_fields, rename_all = "kebab-case")
)]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(
    feature = "serde",
    serde(default, deny_unknown_fields, rename_all = "kebab-case")
)]
pub struct ValueSearch {
    /// Coordinate descents: from the policy's arg-max, the best set so far, and random sets.
    /// Default 16.
    pub starts: usize,
    /// Sets that are gone through with the network: every combination of the best few views of
    /// each slot. Default 2^15: 32 views per slot for M = 3.
    pub combinations: usize,
    /// Of these the best, whose loss is evaluated; the lowest loss is picked. With 1, the network
    /// alone decides. Default 500.
    pub shortlist: usize,
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
            combinations: 1 << 15,
            shortlist: 500,
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

impl VbNvs {
    fn check(&self) -> Result<(), SelectError> {
        let ValueTraining {
            hidden,
            learning_rate,
            steps,
            batch,
            weight,
        } = self.value;
        let ValueSearch {
            starts,
            combinations,
            shortlist,
        } = self.search;
        self.policy.check()?;
        require(hidden > 0, "hidden", hidden, "at least 1")?;
        require(
            learning_rate > 0.0 && learning_rate.is_finite(),
            "learning-rate",
            learning_rate,
            "a positive number",
        )?;
        require(steps > 0, "steps", steps, "at least 1")?;
        require(batch > 0, "batch", batch, "at least 1")?;
        let fits = weight >= 0.0 && weight.is_finite();
        require(fits, "weight", weight, "0 or a positive number")?;
        require(starts > 0, "starts", starts, "at least 1")?;
        require(combinations > 0, "combinations", combinations, "at least 1")?;
        require(shortlist > 0, "shortlist", shortlist, "at least 1")?;
        require(
            self.evaluations > shortlist as u64,
            "evaluations",
            self.evaluations,
            "more than `shortlist`",
        )
    }
}

impl Selector for VbNvs {
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError> {
        self.check()?;
        let mut evaluator = Evaluator::new(problem);
        let mut trainer = Trainer::new(self.policy, problem)?;
        let mut value = Value::new(self.value, problem);
        let budget = self.evaluations - self.search.shortlist as u64;
        while evaluator.asked() < budget {
            let left = budget - evaluator.asked();
            let share = left as f64 / budget as f64;
            let probabilities = trainer.policy().probabilities();
            let sets = trainer.sample(left);
            let losses = evaluator.losses(sets.as_sets())?;
            value.learn(sets.as_sets(), &losses, &probabilities, share);
            let signal = value.error_signal(&probabilities, problem.views());
            trainer.learn(sets.as_sets(), &losses, Some(&signal), share)?;
        }
        let starts = self.starts(problem, &trainer.policy().arg_max(), &value);
        let limits = Limits {
            combinations: self.search.combinations,
            shortlist: self.search.shortlist,
        };
        let shortlist = lowest_sets(&value.network, problem, &starts, limits);
        let losses = evaluator.losses(shortlist.as_sets())?;
        evaluator.finish(best_of(shortlist.as_sets(), &losses))
    }
}

impl VbNvs {
    fn starts(&self, problem: &Problem<'_>, arg_max: &[usize], value: &Value) -> SetList {
        let mut starts = SetList::new(problem.picks());
        starts.push(arg_max);
        starts.push(&best_of(value.sets.as_sets(), &value.targets));
        let mut stream = Stream::new(problem.seed_value(), Purpose::ValueStarts, 0);
        let random = (2..self.search.starts)
            .map(|_| stream.set(problem.views(), problem.picks(), problem.is_distinct()));
        starts.extend(random);
        starts
    }
}

/// A value network and all that it was shown.
struct Value {
    settings: ValueTraining,
    network: ValueNetwork,
    /// Mean and deviation of the first batch's losses: the unit of the network's targets.
    unit: Option<(f64, f64)>,
    sets: SetList,
    targets: Vec<f64>,
    stream: Stream,
}

impl Value {
    fn new(settings: ValueTraining, problem: &Problem<'_>) -> Self {
        Self {
            settings,
            network: ValueNetwork::new(problem, settings.hidden, settings.learning_rate),
            unit: None,
            sets: SetList::new(problem.picks()),
            targets: Vec::new(),
            stream: Stream::new(problem.seed_value(), Purpose::ValueBatches, 0),
        }
    }

    /// Takes in a batch drawn from a policy of the given joined probabilities, and trains.
    fn learn(&mut self, sets: Sets<'_>, losses: &[f64], probabilities: &[f64], share: f64) {
        let (middle, unit) = *self.unit.get_or_insert_with(|| spread(losses));
        let targets = losses.iter().map(|loss| (loss - middle) / unit);
        self.targets.extend(targets);
        for set in sets {
            self.sets.push(set);
        }
        let on_policy = (mean(losses) - middle) / unit;
        for _ in 0..self.settings.steps {
            let drawn: Vec<usize> = (0..self.settings.batch)
                .map(|_| self.stream.below(self.targets.len()))
                .collect();
            let (known, targets) = (self.sets.as_sets(), &self.targets);
            let samples = drawn
                .iter()
                .map(|&index| (known.get(index), targets[index]));
            self.network
                .learn(samples, Some((probabilities, on_policy)), share);
        }
    }

    /// The gradient of the expected loss, in units of its spread, with respect to z.
    fn error_signal(&self, probabilities: &[f64], views: usize) -> Vec<f64> {
        let (_, gradient) = self.network.of_probabilities(probabilities);
        probabilities
            .chunks_exact(views)
            .zip(gradient.chunks_exact(views))
            .flat_map(|(row, gradient)| softmax::backward(row, gradient))
            .map(|gradient| self.settings.weight * gradient)
            .collect()
    }
}

/// Mean and deviation; a deviation of 1 where there is none.
fn spread(losses: &[f64]) -> (f64, f64) {
    let middle = mean(losses);
    let squares = losses.iter().map(|loss| (loss - middle).powi(2));
    let deviation = (squares.sum::<f64>() / losses.len() as f64).sqrt();
    (middle, if deviation > 0.0 { deviation } else { 1.0 })
}
