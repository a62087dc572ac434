//! Soft-max, log-probability and entropy of one row of logits, finite for any finite logits.

use crate::vector::dot;

/// `log softmax(logits)`, with the views of `taken` left out (they become minus infinity).
///
/// `taken` leaves at least one view.
pub(crate) fn log_softmax(logits: &[f64], taken: &[usize]) -> Vec<f64> {
    let mut log_probabilities = logits.to_vec();
    for &view in taken {
        log_probabilities[view] = f64::NEG_INFINITY;
    }
    let largest = log_probabilities
        .iter()
        .copied()
        .fold(f64::NEG_INFINITY, f64::max);
    // At least 1, from the largest.
    let sum: f64 = log_probabilities
        .iter()
        .map(|logit| (logit - largest).exp())
        .sum();
    // Two steps: `largest + ln(sum)` would round the logarithm away beside a large logit.
    let log_sum = sum.ln();
    for logit in &mut log_probabilities {
        *logit = (*logit - largest) - log_sum;
    }
    log_probabilities
}

/// `softmax(logits)`, with the views of `taken` left out (they become 0).
pub(crate) fn softmax(logits: &[f64], taken: &[usize]) -> Vec<f64> {
    let mut probabilities = log_softmax(logits, taken);
    for probability in &mut probabilities {
        *probability = probability.exp();
    }
    probabilities
}

/// `-sum p log p` in nats, of a row without views left out. Where p underflows to 0, log p is
/// still finite, and the product is 0.
pub(crate) fn entropy(log_probabilities: &[f64]) -> f64 {
    -log_probabilities
        .iter()
        .map(|log_probability| log_probability.exp() * log_probability)
        .sum::<f64>()
}

/// Gradient of [`entropy`] with respect to the logits: `-p (log p + entropy)`.
pub(crate) fn entropy_gradient(log_probabilities: &[f64]) -> impl Iterator<Item = f64> + '_ {
    let entropy = entropy(log_probabilities);
    log_probabilities
        .iter()
        .map(move |log_probability| -log_probability.exp() * (log_probability + entropy))
}

/// Passes a gradient with respect to `softmax(logits)` back to the logits:
/// `p (g - sum p g)`.
pub(crate) fn backward(probabilities: &[f64], gradient: &[f64]) -> impl Iterator<Item = f64> {
    let mean = dot(probabilities, gradient);
    probabilities
        .iter()
        .zip(gradient)
        .map(move |(p, g)| p * (g - mean))
}
