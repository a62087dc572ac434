//! The policy is a distribution over sets, and its gradients are those of its logarithm.

use std::collections::HashMap;

use safetensors::Dtype;

use super::*;
use crate::golden::{golden, uniform};
use crate::sets::is_distinct;

const SLOTS: usize = 3;
const VIEWS: usize = 5;

impl Policy {
    pub(super) fn of(logits: Vec<f64>, views: usize, distinct: bool) -> Self {
        Self {
            logits,
            views,
            distinct,
        }
    }

    /// The log-probability of drawing `set`, in nats.
    pub(super) fn log_probability(&self, set: &[usize]) -> f64 {
        let slots = self.rows().zip(set).enumerate();
        slots
            .map(|(slot, (row, &view))| softmax::log_softmax(row, self.taken(set, slot))[view])
            .sum()
    }

    /// Sum over the slots of the entropy of `softmax(z_m)`, in nats: from 0 to `M ln N`.
    pub(super) fn entropy(&self) -> f64 {
        let entropy = |row| softmax::entropy(&softmax::log_softmax(row, &[]));
        self.rows().map(entropy).sum()
    }
}

/// Every set of three views.
fn all_sets(distinct: bool) -> impl Iterator<Item = [usize; SLOTS]> {
    let all = (0..VIEWS.pow(3)).map(|i| [i / 25, i / 5 % 5, i % 5]);
    all.filter(move |set| !distinct || is_distinct(set))
}

fn logits() -> Vec<f64> {
    let numbers = uniform("policy", SLOTS * VIEWS).into_iter();
    numbers.map(|u| 2.0 * u).collect()
}

fn policy(logits: Vec<f64>, distinct: bool) -> Policy {
    Policy::of(logits, VIEWS, distinct)
}

/// Central differences of a function of the logits.
fn differences(function: impl Fn(Vec<f64>) -> f64) -> Vec<f64> {
    let step = 1e-5;
    (0..SLOTS * VIEWS)
        .map(|index| {
            let moved = |by: f64| {
                let mut logits = logits();
                logits[index] += by;
                function(logits)
            };
            (moved(step) - moved(-step)) / (2.0 * step)
        })
        .collect()
}

fn assert_close(found: &[f64], expected: &[f64], bound: f64) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < bound, "{found} {expected}");
    }
}

#[test]
fn probabilities_of_all_sets_add_up_to_one() {
    for distinct in [false, true] {
        let policy = policy(logits(), distinct);
        let probability = |set: [usize; SLOTS]| policy.log_probability(&set).exp();
        let sum: f64 = all_sets(distinct).map(probability).sum();
        assert!((sum - 1.0).abs() < 1e-14, "{sum}");
    }
}

#[test]
fn samples_come_as_often_as_they_should() {
    for distinct in [false, true] {
        let policy = policy(logits(), distinct);
        let draws = 50_000;
        let mut counts = HashMap::<Vec<usize>, f64>::new();
        for set in policy.sample(1, 0, draws).as_sets() {
            *counts.entry(set.to_vec()).or_default() += 1.0;
        }
        for set in all_sets(distinct) {
            let expected = draws as f64 * policy.log_probability(&set).exp();
            let count = counts.remove(set.as_slice()).unwrap_or_default();
            // Five standard deviations, and one for the rare ones.
            let bound = 5.0 * expected.sqrt() + 1.0;
            let off = (count - expected).abs();
            assert!(off < bound, "{set:?}: {count} {expected}");
        }
        assert!(counts.is_empty(), "{counts:?}");
    }
}

#[test]
fn reinforce_gradient_matches_differences() {
    for distinct in [false, true] {
        let chosen: Vec<_> = all_sets(distinct).step_by(7).collect();
        let advantages = uniform("advantages", chosen.len());
        let expected = differences(|logits| {
            let policy = policy(logits, distinct);
            let both = chosen.iter().zip(&advantages);
            let weighted = both.map(|(set, advantage)| advantage * policy.log_probability(set));
            weighted.sum::<f64>() / chosen.len() as f64
        });
        let flat = chosen.concat();
        let sets = Sets::new(&flat, SLOTS).expect("whole sets");
        let found = policy(logits(), distinct).reinforce_gradient(sets, &advantages);
        assert_close(&found, &expected, 1e-9);
    }
}

#[test]
fn entropy_and_its_gradient_match_their_definitions() {
    let start = policy(logits(), false);
    let by_definition: f64 = start.probabilities().iter().map(|p| -p * p.ln()).sum();
    assert!((start.entropy() - by_definition).abs() < 1e-14);
    let expected = differences(|logits| policy(logits, false).entropy());
    assert_close(&start.entropy_gradient(), &expected, 1e-9);
    let uniform = policy(vec![0.0; SLOTS * VIEWS], false);
    let largest = SLOTS as f64 * (VIEWS as f64).ln();
    assert!((uniform.entropy() - largest).abs() < 1e-14);
}

#[test]
fn arg_max_is_the_most_probable_view_of_each_slot() {
    let logits = vec![
        0.0, 3.0, 1.0, 2.0, 0.0, //
        0.0, 4.0, 0.0, 0.0, 1.0, //
        5.0, 6.0, 5.0, 5.0, 5.0,
    ];
    assert_eq!(policy(logits.clone(), false).arg_max(), [1, 1, 1]);
    assert_eq!(policy(logits, true).arg_max(), [1, 4, 0]);
}

/// PyTorch's autograd (`reinforce` in `fixtures/golden/make_golden.py`).
#[test]
fn reinforce_gradient_matches_autograd() {
    const VIEWS: usize = 100;
    const BATCH: usize = 16;
    // Inputs go through f32, as the script's `image` has it; q does not.
    let rounded = |value: f64| f64::from(value as f32);
    let numbers = |leaf, len| uniform(&format!("golden/reinforce.{leaf}"), len).into_iter();
    let logits = numbers("z", SLOTS * VIEWS).map(|u| 3.0 * rounded(u));
    let policy = Policy::of(logits.collect(), VIEWS, false);
    let drawn = numbers("q", BATCH * SLOTS).map(|u| (0.5 * (u + 1.0) * 100.0) as usize);
    let drawn: Vec<usize> = drawn.collect();
    let stored = golden("reinforce", "q", Dtype::I64, &[BATCH, SLOTS]).into_iter();
    let views = drawn.iter().map(|&view| view as i64);
    assert!(stored.map(i64::from_le_bytes).eq(views));
    let advantages: Vec<f64> = numbers("advantage", BATCH).map(rounded).collect();

    let sets = Sets::new(&drawn, SLOTS).expect("whole sets");
    let expected = golden("reinforce", "grad", Dtype::F64, &[SLOTS, VIEWS]).into_iter();
    let expected: Vec<f64> = expected.map(f64::from_le_bytes).collect();
    let found = policy.reinforce_gradient(sets, &advantages);
    assert_close(&found, &expected, 1e-15);
    let none = Sets::new(&[], SLOTS).expect("no sets");
    let nothing = policy.reinforce_gradient(none, &[]);
    assert_eq!(nothing, vec![0.0; SLOTS * VIEWS]);
}
