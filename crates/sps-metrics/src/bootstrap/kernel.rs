use crate::metric::Metric;
use crate::moments::LEAST_SUM_OF_SQUARES;
use crate::outcome::{Undefined, in_range};
use crate::percent::percent_error;
use crate::ranks::RankPairs;
use crate::samples::{Pair, Samples};

/// A metric's samples, prepared so that each resample costs one pass over them and no sorting. A
/// resample is given as the number of times each sample occurs.
///
/// Sums are plain `f64` over a few hundred differences from the median truth: an interval needs no
/// twelve digits, but must not lose its own at 1e8 + small.
pub(super) enum Kernel<'a> {
    R2 {
        squared_errors: Vec<f64>,
        squared_deviations: Vec<f64>,
        truth: &'a [f64],
    },
    R2OwnMean {
        squared_errors: Vec<f64>,
        deviations: Vec<f64>,
        truth: &'a [f64],
    },
    Mean {
        errors: Vec<f64>,
        root: bool,
    },
    MedianPercent {
        ascending: Vec<(f64, usize)>,
    },
    Spearman(RankPairs<'a>),
}

/// R² as sums over units: of squared errors, and of squared differences from the reference.
pub(super) struct Ratio {
    errors: Vec<f64>,
    total: Vec<f64>,
}

impl Ratio {
    /// R² when unit i occurs `factors[i]` times; `None` where the total is too small to divide by.
    pub(super) fn value(&self, factors: &[f64]) -> Option<f64> {
        let total = product(&self.total, factors);
        let value = 1.0 - product(&self.errors, factors) / total;
        (total >= LEAST_SUM_OF_SQUARES && value.is_finite()).then_some(value)
    }
}

/// In a fixed order that leaves eight sums in flight.
fn product(values: &[f64], factors: &[f64]) -> f64 {
    const LANES: usize = 8;
    let (values, last_values) = values.as_chunks::<LANES>();
    let (factors, last_factors) = factors.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for (values, factors) in values.iter().zip(factors) {
        for lane in 0..LANES {
            lanes[lane] += factors[lane] * values[lane];
        }
    }
    let last = last_values.iter().zip(last_factors);
    let last: f64 = last.map(|(&value, &factor)| factor * value).sum();
    lanes.iter().sum::<f64>() + last
}

impl<'a> Kernel<'a> {
    /// The metric as sums over `units`, where it is a ratio of such; `unit_of` says which unit each
    /// sample is of, its own where there is none.
    pub(super) fn ratio(&self, unit_of: Option<&[u32]>, units: usize) -> Option<Ratio> {
        let Self::R2 {
            squared_errors,
            squared_deviations,
            ..
        } = self
        else {
            return None;
        };
        let sums = |values: &[f64]| match unit_of {
            None => values.to_vec(),
            Some(unit_of) => {
                let mut sums = vec![0.0; units];
                for (value, &unit) in values.iter().zip(unit_of) {
                    sums[unit as usize] += value;
                }
                sums
            }
        };
        Some(Ratio {
            errors: sums(squared_errors),
            total: sums(squared_deviations),
        })
    }

    /// Of samples that are known to pair up and to be finite.
    pub(super) fn new(metric: Metric, samples: Samples<'a>) -> Result<Self, Undefined> {
        let pairs: Vec<Pair> = samples.pairs()?.collect();
        let errors = pairs.iter().map(|pair| (pair.truth - pair.estimate).abs());
        let squared_errors = || errors.clone().map(square).collect();
        let deviations = |origin| pairs.iter().map(move |pair| pair.truth - origin);
        Ok(match metric {
            Metric::R2(mean) => Self::R2 {
                squared_errors: squared_errors(),
                squared_deviations: deviations(mean.get()).map(square).collect(),
                truth: samples.truth,
            },
            Metric::R2OwnMean => Self::R2OwnMean {
                squared_errors: squared_errors(),
                deviations: deviations(middle(samples.truth)).collect(),
                truth: samples.truth,
            },
            Metric::Mae => Self::Mean {
                errors: errors.collect(),
                root: false,
            },
            Metric::Rmse => Self::Mean {
                errors: squared_errors(),
                root: true,
            },
            Metric::MedianPercentError => Self::MedianPercent {
                ascending: ascending_percent_errors(&pairs),
            },
            Metric::Spearman => Self::Spearman(RankPairs::new(samples)),
        })
    }

    /// The metric's value when sample i occurs `weights[i]` times.
    pub(super) fn value(&self, weights: &[u32]) -> Result<f64, Undefined> {
        match self {
            Self::R2 {
                squared_errors,
                squared_deviations,
                truth,
            } => {
                let total = weighted_sum(squared_deviations, weights, |square| square);
                explained(squared_errors, total, weights, truth)
            }
            Self::R2OwnMean {
                squared_errors,
                deviations,
                truth,
            } => {
                let mean =
                    weighted_sum(deviations, weights, |deviation| deviation) / occupied(weights)?;
                let total = weighted_sum(deviations, weights, |deviation| square(deviation - mean));
                // Rounding of the mean can keep the sum over equal truths from being zero.
                let total = if constant(truth, weights).is_some() {
                    0.0
                } else {
                    total
                };
                explained(squared_errors, total, weights, truth)
            }
            Self::Mean { errors, root } => {
                let mean = weighted_sum(errors, weights, |error| error) / occupied(weights)?;
                in_range(if *root { mean.sqrt() } else { mean })
            }
            Self::MedianPercent { ascending } => weighted_median(ascending, weights),
            Self::Spearman(ranks) => ranks.correlation(weights),
        }
    }
}

/// The middle truth: near the bulk of them, so that differences from it are exact for that bulk.
fn middle(truth: &[f64]) -> f64 {
    let mut truth = truth.to_vec();
    let middle = truth.len() / 2;
    if truth.is_empty() {
        return 0.0;
    }
    *truth.select_nth_unstable_by(middle, f64::total_cmp).1
}

fn ascending_percent_errors(pairs: &[Pair]) -> Vec<(f64, usize)> {
    let errors = pairs.iter().enumerate();
    let mut ascending: Vec<(f64, usize)> = errors
        .filter_map(|(index, &pair)| Some((percent_error(pair)?, index)))
        .collect();
    ascending.sort_unstable_by(|(a, _), (b, _)| a.total_cmp(b));
    ascending
}

/// As [`product`], of whole numbers.
fn weighted_sum(values: &[f64], weights: &[u32], term: impl Fn(f64) -> f64) -> f64 {
    const LANES: usize = 8;
    let (values, last_values) = values.as_chunks::<LANES>();
    let (weights, last_weights) = weights.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for (values, weights) in values.iter().zip(weights) {
        for lane in 0..LANES {
            lanes[lane] += f64::from(weights[lane]) * term(values[lane]);
        }
    }
    let last = last_values.iter().zip(last_weights);
    let last: f64 = last
        .map(|(&value, &weight)| f64::from(weight) * term(value))
        .sum();
    lanes.iter().sum::<f64>() + last
}

/// How many samples the resample holds.
fn occupied(weights: &[u32]) -> Result<f64, Undefined> {
    let samples: u64 = weights.iter().map(|&weight| u64::from(weight)).sum();
    if samples == 0 {
        Err(Undefined::Empty)
    } else {
        Ok(samples as f64)
    }
}

/// R² from a sum of squared differences from the reference.
fn explained(
    squared_errors: &[f64],
    total: f64,
    weights: &[u32],
    truth: &[f64],
) -> Result<f64, Undefined> {
    if total >= LEAST_SUM_OF_SQUARES {
        let unexplained = weighted_sum(squared_errors, weights, |square| square);
        return in_range(1.0 - unexplained / total);
    }
    occupied(weights)?;
    Err(
        constant(truth, weights).map_or(Undefined::OutOfRange, |value| Undefined::ConstantTruth {
            value,
        }),
    )
}

/// The value of all truths of the resample, if they have one.
fn constant(truth: &[f64], weights: &[u32]) -> Option<f64> {
    let drawn = truth.iter().zip(weights).filter(|(_, weight)| **weight > 0);
    let mut drawn = drawn.map(|(&truth, _)| truth);
    let first = drawn.next()?;
    drawn.all(|truth| truth == first).then_some(first)
}

fn square(value: f64) -> f64 {
    value * value
}

fn weighted_median(ascending: &[(f64, usize)], weights: &[u32]) -> Result<f64, Undefined> {
    let drawn = occupied(weights)?;
    let weight = |&(_, index): &(f64, usize)| u64::from(weights[index]);
    let total: u64 = ascending.iter().map(weight).sum();
    let mut below = 0;
    let mut lower = None;
    for entry in ascending {
        below += weight(entry);
        if lower.is_none() && below > total.saturating_sub(1) / 2 {
            lower = Some(entry.0);
        }
        if let Some(lower) = lower.filter(|_| below > total / 2) {
            return in_range(f64::midpoint(lower, entry.0));
        }
    }
    Err(Undefined::AllTruthsZero {
        samples: drawn as usize,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::samples::TrainingMean;

    fn metrics() -> [Metric; 6] {
        let mean = TrainingMean::new(1.25).expect("a finite mean");
        [
            Metric::R2(mean),
            Metric::R2OwnMean,
            Metric::Mae,
            Metric::Rmse,
            Metric::MedianPercentError,
            Metric::Spearman,
        ]
    }

    fn replicated(values: &[f64], weights: &[u32]) -> Vec<f64> {
        let repeats = values.iter().zip(weights);
        repeats
            .flat_map(|(&value, &weight)| std::iter::repeat_n(value, weight as usize))
            .collect()
    }

    proptest! {
        /// Few distinct values, so that ties, zeros and constant resamples are frequent.
        #[test]
        fn weights_score_as_copies_do(
            samples in prop::collection::vec((-2..3_i32, -3..4_i32, 0..4_u32), 1..30),
        ) {
            let truth: Vec<f64> = samples.iter().map(|sample| f64::from(sample.0) * 0.7).collect();
            let estimate: Vec<f64> = samples.iter().map(|sample| f64::from(sample.1) * 0.9).collect();
            let weights: Vec<u32> = samples.iter().map(|sample| sample.2).collect();
            let (copied_truth, copied_estimate) =
                (replicated(&truth, &weights), replicated(&estimate, &weights));
            for metric in metrics() {
                let samples = Samples { truth: &truth, estimate: &estimate };
                let kernel = Kernel::new(metric, samples).expect("equal lengths");
                let copies = Samples { truth: &copied_truth, estimate: &copied_estimate };
                match (kernel.value(&weights), metric.score(copies)) {
                    (Ok(found), Ok(expected)) => {
                        let off = (found - expected.value).abs();
                        prop_assert!(off <= 1e-12 * expected.value.abs().max(1.0), "{metric:?}");
                    }
                    // A single copy is a constant truth here.
                    (Err(_), Err(Undefined::TooFewSamples { .. })) => {}
                    (found, expected) => prop_assert_eq!(found.err(), expected.err(), "{:?}", metric),
                }
            }
        }
    }
}
