//! Inputs on which the usual form of a score goes wrong.
//!
//! Each test holds the crate to a closed form or to exact integers, and computes the naive form
//! (module `naive`, after common libraries) beside it: an assertion of each test says that the
//! naive form breaks the same bound. So no bound here can be met by falling back to it.
//!
//! Beyond that, each of these was put into the crate once by hand, and the tests named turned red:
//!
//! | change | red |
//! |---|---|
//! | sums in plain `f64` (`Double::add`) | all 1e8, outlier and ten-million tests |
//! | products in plain `f64` (`Double::mul`) | outlier |
//! | sums about zero, not the first value | 1e8, ten million, last place, constant truth |
//! | a constant truth not looked for | constant truth, equal truths that are left |
//! | R² as 1 - ratio | R² near zero |
//! | no check of the range of sums or scores | squares and percentages beyond `f64` |
//! | an epsilon in the percentage, or zero truths kept | zero, all zero, near zero |
//! | half the sum of the middle two | percentages beyond `f64` |
//! | no check for NaN; its index not moved by a merge | all NaN; one NaN |
//! | ties by total order, or none | signed zeros; many ties |
//! | truths not moved to their middle | interval at 1e8 |
//! | one surface, or one sample for its own mean, allowed | one sample |
//! | conformal rank by plain product, or of n | rank, too few samples |

mod intervals;
mod sums;
mod truths;

use crate::support::relative_error;

/// What people write first.
mod naive {
    /// 1 - Σe² / (Σt² - (Σt)² / n).
    pub(super) fn r2_of_sums(truth: &[f64], estimate: &[f64]) -> f64 {
        let n = truth.len() as f64;
        let sum: f64 = truth.iter().sum();
        let squares: f64 = truth.iter().map(|t| t * t).sum();
        1.0 - squared_error(truth, estimate) / (squares - sum * sum / n)
    }

    /// 1 - Σe² / Σ(t - mean)², in two passes.
    pub(super) fn r2(truth: &[f64], estimate: &[f64], mean: f64) -> f64 {
        let total: f64 = truth.iter().map(|t| (t - mean).powi(2)).sum();
        1.0 - squared_error(truth, estimate) / total
    }

    pub(super) fn squared_error(truth: &[f64], estimate: &[f64]) -> f64 {
        let both = truth.iter().zip(estimate);
        both.map(|(t, p)| (t - p).powi(2)).sum()
    }

    pub(super) fn mean(values: &[f64]) -> f64 {
        values.iter().sum::<f64>() / values.len() as f64
    }

    /// Welford's update in `f64`, which most streaming libraries use.
    pub(super) fn welford_squares(values: impl Iterator<Item = f64>) -> f64 {
        let (mut n, mut mean, mut squares) = (0.0, 0.0, 0.0);
        for value in values {
            n += 1.0;
            let delta = value - mean;
            mean += delta / n;
            squares += delta * (value - mean);
        }
        squares
    }

    /// scikit-learn's guard against zero: the truth, but at least the machine epsilon.
    pub(super) fn percent_errors(truth: &[f64], estimate: &[f64]) -> Vec<f64> {
        let both = truth.iter().zip(estimate);
        both.map(|(t, p)| 100.0 * (t - p).abs() / t.abs().max(f64::EPSILON))
            .collect()
    }

    /// 1 - 6 Σd² / (n (n² - 1)) of places in the sorted order, as if no values were equal.
    pub(super) fn spearman(truth: &[f64], estimate: &[f64]) -> f64 {
        let places = |values: &[f64]| {
            let mut order: Vec<usize> = (0..values.len()).collect();
            order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
            let mut places = vec![0.0; values.len()];
            for (place, index) in order.into_iter().enumerate() {
                places[index] = place as f64;
            }
            places
        };
        let n = truth.len() as f64;
        let squares = squared_error(&places(truth), &places(estimate));
        1.0 - 6.0 * squares / (n * (n * n - 1.0))
    }

    pub(super) fn median(mut values: Vec<f64>) -> f64 {
        values.sort_by(f64::total_cmp);
        let half = values.len() / 2;
        if values.len().is_multiple_of(2) {
            0.5 * (values[half - 1] + values[half])
        } else {
            values[half]
        }
    }
}

/// Holds `found` to `expected` within a relative `bound`, which the naive form's number misses.
#[track_caller]
fn within(case: &str, found: f64, expected: f64, bound: f64, naive: f64) {
    let (error, naive) = (
        relative_error(found, expected),
        relative_error(naive, expected),
    );
    println!("{case}: error {error:.1e}, bound {bound:.0e}, naive form {naive:.1e}");
    assert!(error <= bound, "{case}: {found:e} against {expected:e}");
    assert!(naive.is_nan() || naive > bound, "{case}: the naive form");
}
