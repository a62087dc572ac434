use crate::outcome::{Outcome, Score, Undefined};
use crate::samples::Samples;

/// Spearman's correlation of samples that are known to pair up and to be finite.
pub(crate) fn spearman(samples: Samples<'_>) -> Outcome {
    let once = vec![1; samples.truth.len()];
    let value = RankPairs::new(samples).correlation(&once)?;
    Ok(Score {
        value,
        samples: once.len(),
        zero_truths: 0,
    })
}

/// The order of truths and estimates, from which the correlation of any resample follows without
/// sorting again.
pub(crate) struct RankPairs<'a> {
    samples: Samples<'a>,
    truth: Order,
    estimate: Order,
}

impl<'a> RankPairs<'a> {
    pub(crate) fn new(samples: Samples<'a>) -> Self {
        Self {
            samples,
            truth: Order::new(samples.truth),
            estimate: Order::new(samples.estimate),
        }
    }

    /// Pearson's correlation of the ranks when sample i occurs `weights[i]` times. Doubled ranks
    /// about their mean are integers, so the sums are exact in any order.
    pub(crate) fn correlation(&self, weights: &[u32]) -> Result<f64, Undefined> {
        let found: usize = weights.iter().map(|&weight| weight as usize).sum();
        match found {
            0 => return Err(Undefined::Empty),
            1 => return Err(Undefined::TooFewSamples { found, needed: 2 }),
            _ => {}
        }
        let truth = self.truth.centred_ranks(weights, found);
        let estimate = self.estimate.centred_ranks(weights, found);
        let [mut tt, mut te, mut ee] = [0_i128; 3];
        for ((&t, &e), &weight) in truth.iter().zip(&estimate).zip(weights) {
            let (t, e, weight) = (i128::from(t), i128::from(e), i128::from(weight));
            tt += weight * t * t;
            te += weight * t * e;
            ee += weight * e * e;
        }
        if tt == 0 {
            let value = any(self.samples.truth, weights);
            return Err(Undefined::ConstantTruth { value });
        }
        if ee == 0 {
            let value = any(self.samples.estimate, weights);
            return Err(Undefined::ConstantEstimate { value });
        }
        Ok((te as f64 / (tt as f64 * ee as f64).sqrt()).clamp(-1.0, 1.0))
    }
}

/// Indices in ascending order of value, and where in it each run of equal values ends.
struct Order {
    ascending: Vec<usize>,
    tie_ends: Vec<usize>,
}

impl Order {
    fn new(values: &[f64]) -> Self {
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
    fn centred_ranks(&self, weights: &[u32], total: usize) -> Vec<i64> {
        let mut ranks = vec![0; weights.len()];
        let mut below = 0;
        let mut start = 0;
        for &end in &self.tie_ends {
            let tie = &self.ascending[start..end];
            let size: i64 = tie.iter().map(|&index| i64::from(weights[index])).sum();
            for &index in tie {
                ranks[index] = 2 * below + size - total as i64;
            }
            below += size;
            start = end;
        }
        ranks
    }
}

/// The value that all samples of the resample have.
fn any(values: &[f64], weights: &[u32]) -> f64 {
    let mut drawn = values
        .iter()
        .zip(weights)
        .filter(|(_, weight)| **weight > 0);
    drawn.next().map_or(f64::NAN, |(&value, _)| value)
}
