//! Arithmetic on slices.

/// The mean of at least one value, exact where all are equal: taken from the first.
pub(crate) fn mean(values: &[f64]) -> f64 {
    let first = values[0];
    first + values.iter().map(|value| value - first).sum::<f64>() / values.len() as f64
}

/// `sum += weight * other`.
pub(crate) fn add(sum: &mut [f64], weight: f64, other: &[f64]) {
    for (sum, other) in sum.iter_mut().zip(other) {
        *sum += weight * other;
    }
}

pub(crate) fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}
