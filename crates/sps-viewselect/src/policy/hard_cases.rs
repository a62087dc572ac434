//! Logits of +-1e4 and more, collapsed policies.

use super::Policy;
use crate::sets::Sets;

fn finite(values: &[f64]) -> bool {
    values.iter().all(|value| value.is_finite())
}

/// What people write first: no largest logit taken out.
mod naive {
    pub(super) fn softmax(logits: &[f64]) -> Vec<f64> {
        let sum: f64 = logits.iter().map(|z| z.exp()).sum();
        logits.iter().map(|z| z.exp() / sum).collect()
    }

    /// `ln` of a probability, by way of the probability.
    pub(super) fn log_probability(logits: &[f64], view: usize) -> f64 {
        let largest = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let shifted: Vec<f64> = logits.iter().map(|z| z - largest).collect();
        softmax(&shifted)[view].ln()
    }

    /// `max + ln sum`, which forgets the logarithm beside a large logit.
    pub(super) fn probability(logits: &[f64], view: usize) -> f64 {
        let largest = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = logits.iter().map(|z| (z - largest).exp()).sum();
        (logits[view] - (largest + sum.ln())).exp()
    }
}

/// Holds a number to its closed form within an absolute `bound`, which the naive form misses.
#[track_caller]
fn within(case: &str, found: f64, expected: f64, bound: f64, naive: f64) {
    let (error, naive) = ((found - expected).abs(), (naive - expected).abs());
    println!("{case}: error {error:.1e}, bound {bound:.0e}, naive form {naive:.1e}");
    assert!(error <= bound, "{case}: {found:e} against {expected:e}");
    assert!(naive.is_nan() || naive > bound, "{case}: the naive form");
}

fn assert_all_finite(policy: &Policy, distinct_set: &[usize]) {
    assert!(finite(&policy.probabilities()));
    assert!(policy.entropy().is_finite() && policy.entropy() >= -1e-12);
    assert!(finite(&policy.entropy_gradient()));
    assert!(policy.log_probability(distinct_set).is_finite());
    let sets = Sets::new(distinct_set, distinct_set.len()).expect("one set");
    assert!(finite(&policy.reinforce_gradient(sets, &[1.0])));
    for set in policy.sample(0, 0, 100).as_sets() {
        assert!(policy.log_probability(set).is_finite());
    }
}

#[test]
fn logits_of_ten_thousand_stay_finite() {
    for distinct in [false, true] {
        for (up, down) in [(1e4, -1e4), (1e4, 1e4), (-1e4, -1e4), (1e300, -1e300)] {
            let logits = vec![up, down, down, down, up, down];
            let policy = Policy::of(logits, 3, distinct);
            assert_all_finite(&policy, &[0, 1]);
            assert_all_finite(&policy, &[2, 0]);
        }
    }
    assert!(naive::softmax(&[1e4, -1e4, -1e4])[0].is_nan());
}

#[test]
fn what_underflows_has_its_exact_logarithm() {
    let logits = vec![1e4, -1e4, -1e4];
    let lost = naive::log_probability(&logits, 1);
    let policy = Policy::of(logits, 3, false);
    assert_eq!(policy.probabilities(), [1.0, 0.0, 0.0]);
    let found = policy.log_probability(&[1]);
    within("logarithm of what underflows", found, -2e4, 0.0, lost);
    assert_eq!(policy.log_probability(&[0]), 0.0);
    assert_eq!(policy.entropy(), 0.0);
}

#[test]
fn equal_logits_are_uniform_however_large() {
    // logsumexp as `max + ln(sum)` is 1e16 here, and every probability 1.
    let policy = Policy::of(vec![1e16; 4], 4, false);
    for (view, probability) in policy.probabilities().into_iter().enumerate() {
        let plain = naive::probability(&[1e16; 4], view);
        within("equal logits of 1e16", probability, 0.25, 1e-15, plain);
    }
    assert!((policy.entropy() - 4.0_f64.ln()).abs() < 1e-15);
}

#[test]
fn a_collapsed_policy_draws_one_set_and_has_no_gradient_there() {
    let mut logits = vec![0.0; 30];
    logits[3] = 1e4;
    logits[10 + 7] = 1e4;
    logits[20 + 3] = 1e4;
    let free = Policy::of(logits.clone(), 10, false);
    let drawn = free.sample(5, 0, 50);
    assert!(drawn.as_sets().iter().all(|set| set == [3, 7, 3]));
    let gradient = free.reinforce_gradient(drawn.as_sets(), &[1.0; 50]);
    assert!(gradient.iter().all(|gradient| gradient.abs() < 1e-12));

    // Distinct: slot 2 has to leave its view, and is uniform over the eight that are left.
    // By masking probabilities that have underflowed, nothing is left to divide by.
    let masked = naive::softmax(&[[0.0; 10].as_slice(), &[700.0]].concat());
    let masked = (masked[0] / (1.0 - masked[10])).ln();
    let distinct = Policy::of(logits, 10, true);
    for set in distinct.sample(5, 0, 200).as_sets() {
        assert!(set[..2] == [3, 7] && set[2] != 3 && set[2] != 7);
        let found = distinct.log_probability(set);
        within("collapsed policy", found, -(8.0_f64.ln()), 1e-12, masked);
    }
    assert_eq!(distinct.arg_max(), [3, 7, 0]);
}

#[test]
fn distinct_slots_that_all_want_one_view_stay_finite() {
    let logits = [[1e4, -1e4, -1e4]; 3].concat();
    let policy = Policy::of(logits, 3, true);
    assert_eq!(policy.arg_max(), [0, 1, 2]);
    let found = policy.log_probability(&[0, 1, 2]);
    let plain = naive::softmax(&[1e4, -1e4, -1e4])[0].ln();
    let expected = -(2.0_f64.ln());
    within("slots that want one view", found, expected, 1e-12, plain);
    assert_all_finite(&policy, &[2, 1, 0]);
}

/// Its entropy as a share of the largest possible is 0 / 0.
#[test]
fn one_view_has_no_entropy() {
    let policy = Policy::of(vec![0.0], 1, false);
    assert_eq!(policy.entropy(), 0.0);
    assert_eq!(policy.entropy_gradient(), [0.0]);
    assert!((policy.entropy() / 1.0_f64.ln()).is_nan(), "the naive form");
}
