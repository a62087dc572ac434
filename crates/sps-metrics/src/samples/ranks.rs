use crate::outcome::{Outcome, Undefined, score};
use crate::samples::Samples;

/// Spearman's correlation of samples that are known to pair up and to be finite: Pearson's of the
/// ranks.
pub(crate) fn spearman(samples: Samples<'_>) -> Outcome {
    let found = samples.truth.len();
    if found < 2 {
        return Err(Undefined::TooFewSamples { found, needed: 2 });
    }
    let [truth, estimate] =
        [samples.truth, samples.estimate].map(|values| Order::of(values).ranks());
    // Doubled ranks about their mean are integers, so the sums are exact in any order.
    let product = |a: &[i64], b: &[i64]| -> i128 {
        let both = a.iter().zip(b);
        both.map(|(&a, &b)| i128::from(a) * i128::from(b)).sum()
    };
    let (tt, ee) = (product(&truth, &truth), product(&estimate, &estimate));
    let te = product(&truth, &estimate);
    if tt == 0 {
        let value = samples.truth[0];
        return Err(Undefined::ConstantTruth { value });
    }
    if ee == 0 {
        let value = samples.estimate[0];
        return Err(Undefined::ConstantEstimate { value });
    }
    let correlation = te as f64 / (tt as f64 * ee as f64).sqrt();
    score(correlation.clamp(-1.0, 1.0), found)
}

/// Indices in ascending order of value, and where in it each run of equal values ends.
pub(crate) struct Order {
    pub(crate) ascending: Vec<usize>,
    pub(crate) tie_ends: Vec<usize>,
}

impl Order {
    pub(crate) fn of(values: &[f64]) -> Self {
        let mut sorted: Vec<(usize, f64)> = values.iter().copied().enumerate().collect();
        sorted.sort_unstable_by(|(_, a), (_, b)| a.total_cmp(b));
        let ties = sorted.chunk_by(|(_, a), (_, b)| a == b);
        let tie_ends = ties.scan(0, |end, tie| {
            *end += tie.len();
            Some(*end)
        });
        Self {
            tie_ends: tie_ends.collect(),
            ascending: sorted.iter().map(|&(index, _)| index).collect(),
        }
    }

    /// Twice the average rank of each sample, less twice the mean rank.
    pub(crate) fn ranks(&self) -> Vec<i64> {
        let total = self.ascending.len();
        let mut ranks = vec![0; total];
        let mut start = 0;
        for &end in &self.tie_ends {
            for &index in &self.ascending[start..end] {
                ranks[index] = (start + end) as i64 - total as i64;
            }
            start = end;
        }
        ranks
    }
}
