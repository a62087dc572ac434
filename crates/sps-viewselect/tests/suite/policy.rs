//! The policy is a distribution over sets, and its gradients are those of its logarithm.

use std::collections::HashMap;

use sps_viewselect::{Policy, Sets};

use crate::support::all_sets;
use crate::uniform::uniform;

const SLOTS: usize = 3;
const VIEWS: usize = 5;

fn logits() -> Vec<f64> {
    uniform("policy")
        .map(|u| 2.0 * u)
        .take(SLOTS * VIEWS)
        .collect()
}

fn policy(logits: Vec<f64>, distinct: bool) -> Policy {
    Policy::from_logits(logits, SLOTS, VIEWS, distinct).expect("finite logits")
}

fn probability(policy: &Policy, set: &[usize]) -> f64 {
    policy.log_probability(set).expect("a possible set").exp()
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
        let sets = all_sets(VIEWS, SLOTS, distinct);
        let sum: f64 = sets.iter().map(|set| probability(&policy, set)).sum();
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
        for set in all_sets(VIEWS, SLOTS, distinct) {
            let expected = draws as f64 * probability(&policy, &set);
            let count = counts.remove(&set).unwrap_or_default();
            // Five standard deviations, and one for the rare ones.
            let bound = 5.0 * expected.sqrt() + 1.0;
            assert!(
                (count - expected).abs() < bound,
                "{set:?}: {count} {expected}"
            );
        }
        assert!(counts.is_empty(), "{counts:?}");
    }
}

#[test]
fn reinforce_gradient_matches_differences() {
    for distinct in [false, true] {
        let sets = all_sets(VIEWS, SLOTS, distinct);
        let chosen: Vec<Vec<usize>> = sets.into_iter().step_by(7).collect();
        let advantages: Vec<f64> = uniform("advantages").take(chosen.len()).collect();
        let expected = differences(|logits| {
            let policy = policy(logits, distinct);
            let weighted = chosen.iter().zip(&advantages).map(|(set, advantage)| {
                advantage * policy.log_probability(set).expect("a possible set")
            });
            weighted.sum::<f64>() / chosen.len() as f64
        });
        let flat = chosen.concat();
        let sets = Sets::new(&flat, SLOTS).expect("whole sets");
        let found = policy(logits(), distinct).reinforce_gradient(sets, &advantages);
        assert_close(&found.expect("possible sets"), &expected, 1e-9);
    }
}

#[test]
fn entropy_and_its_gradient_match_their_definitions() {
    let start = policy(logits(), false);
    let by_definition: f64 = start.probabilities().iter().map(|p| -p * p.ln()).sum();
    assert!((start.entropy() - by_definition).abs() < 1e-14);
    let expected = differences(|logits| policy(logits, false).entropy());
    assert_close(&start.entropy_gradient(), &expected, 1e-9);
    let uniform = Policy::uniform(SLOTS, VIEWS, false).expect("views enough");
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
