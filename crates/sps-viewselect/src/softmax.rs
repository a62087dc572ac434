//! Soft-max, log-probability and entropy of one row of logits, finite for any finite logits.

use crate::vector::dot;

/// `log softmax(logits)`, with the views of `taken` left out (they become minus infinity).
///
/// `taken` leaves at least one view.
pub(crate) fn log_softmax(logits: &[f64], taken: &[usize]) -> Vec<f64> {
    let mut row = logits.to_vec();
    for &view in taken {
        row[view] = f64::NEG_INFINITY;
    }
    let largest = row.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // At least 1, from the largest.
    let sum: f64 = row.iter().map(|logit| (logit - largest).exp()).sum();
    // Two steps: `largest + ln(sum)` would round the logarithm away beside a large logit.
    let log_sum = sum.ln();
    for logit in &mut row {
        *logit = (*logit - largest) - log_sum;
    }
    row
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
    let terms = log_probabilities.iter().map(|log_p| log_p.exp() * log_p);
    -terms.sum::<f64>()
}

/// Gradient of [`entropy`] with respect to the logits: `-p (log p + entropy)`.
pub(crate) fn entropy_gradient(log_probabilities: &[f64]) -> impl Iterator<Item = f64> + '_ {
    let entropy = entropy(log_probabilities);
    let views = log_probabilities.iter();
    views.map(move |log_p| -log_p.exp() * (log_p + entropy))
}

/// Passes a gradient with respect to `softmax(logits)` back to the logits:
/// `p (g - sum p g)`.
pub(crate) fn backward(probabilities: &[f64], gradient: &[f64]) -> impl Iterator<Item = f64> {
    let mean = dot(probabilities, gradient);
    let views = probabilities.iter().zip(gradient);
    views.map(move |(p, g)| p * (g - mean))
}
