//! What holds for any samples.

use proptest::prelude::*;
use proptest::sample::Index;
use sps_metrics::{Metric, Moments, Outcome, Pair, ScoreAccumulator};

use crate::support::{
    AT_1E8, Exact, UNIT, Units, every_metric, merged, relative_error, samples, training_mean, value,
};

/// What the crate promises.
const PROMISED: f64 = 1e-12;
/// What it keeps: two roundings.
const KEPT: f64 = 5e-16;

const OFFSETS: [i64; 3] = [0, AT_1E8, -(3 << 30)];

fn any_units() -> impl Strategy<Value = Vec<Units>> {
    let sample = (-(1_i64 << 30)..1 << 30, -(1_i64 << 28)..1 << 28);
    let samples = prop::collection::vec(sample, 2..60);
    (samples, prop::sample::select(&OFFSETS)).prop_map(|(samples, offset)| {
        let units = samples.into_iter().map(|(truth, error)| Units {
            truth: truth + offset,
            estimate: truth + offset + error,
        });
        units.collect()
    })
}

/// Any sign and nine decades, nothing dyadic.
fn any_pairs() -> impl Strategy<Value = Vec<Pair>> {
    let number =
        || (-1.0..1.0_f64, -4..5_i32).prop_map(|(mantissa, power)| mantissa * 10_f64.powi(power));
    let pair = (number(), number()).prop_map(|(truth, estimate)| Pair { truth, estimate });
    prop::collection::vec(pair, 2..60)
}

fn apart(pairs: &[Pair]) -> (Vec<f64>, Vec<f64>) {
    pairs.iter().map(|pair| (pair.truth, pair.estimate)).unzip()
}

fn scored(metric: Metric, pairs: &[Pair]) -> Outcome {
    let (truth, estimate) = apart(pairs);
    metric.score(samples(&truth, &estimate))
}

fn mapped(pairs: &[Pair], map: impl Fn(f64) -> f64) -> Vec<Pair> {
    let pairs = pairs.iter().map(|pair| Pair {
        truth: map(pair.truth),
        estimate: map(pair.estimate),
    });
    pairs.collect()
}

/// Equal within the bound, or undefined for the same kind of reason.
fn agree(left: &Outcome, right: &Outcome, bound: f64) -> bool {
    match (left, right) {
        (Ok(left), Ok(right)) => {
            relative_error(left.value, right.value) <= bound
                && (left.samples, left.zero_truths) == (right.samples, right.zero_truths)
        }
        (Err(left), Err(right)) => std::mem::discriminant(left) == std::mem::discriminant(right),
        _ => false,
    }
}

/// Merges the samples in an order and in parts that the indices choose.
fn in_parts(pairs: &[Pair], cuts: &[Index]) -> ScoreAccumulator {
    let mut parts = vec![ScoreAccumulator::new(); 5];
    for (pair, cut) in pairs.iter().zip(cuts.iter().cycle()) {
        let part = cut.index(parts.len());
        parts[part].push(*pair);
    }
    for cut in cuts {
        if parts.len() > 1 {
            let later = parts.swap_remove(cut.index(parts.len()));
            let into = cut.index(parts.len());
            parts[into].merge(&later);
        }
    }
    merged(&parts)
}

proptest! {
    #[test]
    fn scores_equal_exact_integers(units in any_units()) {
        let exact: Exact = units.iter().copied().collect();
        let pairs: Vec<Pair> = units.iter().map(|units| units.pair()).collect();
        let sums: ScoreAccumulator = pairs.iter().copied().collect();
        prop_assert!(relative_error(value(&sums.mae()), exact.mae()) <= KEPT);
        prop_assert!(relative_error(value(&sums.rmse()), exact.rmse()) <= KEPT);
        if let Ok(score) = sums.r2_own_mean() {
            prop_assert!(relative_error(score.value, exact.r2_own_mean()) <= KEPT);
        }
        let mean = units[0].estimate;
        if let Ok(score) = sums.r2(training_mean(mean as f64 * UNIT)) {
            prop_assert!(relative_error(score.value, exact.r2(mean)) <= KEPT);
        }
        let moments: Moments = pairs.iter().map(|pair| pair.truth).collect();
        let variance = moments.sample_variance().expect("two values");
        prop_assert!(relative_error(variance, exact.variance()) <= KEPT);
    }

    #[test]
    fn any_order_and_split_score_alike(
        pairs in any_pairs(),
        offset in prop::sample::select(&[0.0, 1e8, -7e11][..]),
        cuts in prop::collection::vec(any::<Index>(), 9),
    ) {
        let pairs = mapped(&pairs, |value| value + offset);
        let whole: ScoreAccumulator = pairs.iter().copied().collect();
        let merged = in_parts(&pairs, &cuts);
        let mean = training_mean(offset + 0.3);
        prop_assert!(agree(&whole.r2(mean), &merged.r2(mean), KEPT));
        prop_assert!(agree(&whole.r2_own_mean(), &merged.r2_own_mean(), KEPT));
        prop_assert!(agree(&whole.mae(), &merged.mae(), KEPT));
        prop_assert!(agree(&whole.rmse(), &merged.rmse(), KEPT));
    }

    #[test]
    fn permutations_score_alike(pairs in any_pairs(), turn in any::<Index>()) {
        let mut turned = pairs.clone();
        turned.rotate_left(turn.index(pairs.len()));
        turned.reverse();
        for metric in every_metric(0.3) {
            prop_assert!(agree(&scored(metric, &pairs), &scored(metric, &turned), KEPT));
        }
    }

    /// Dyadic samples, so that the shift itself is exact.
    #[test]
    fn shifts_change_no_score_but_the_percentage(units in any_units(), shift in -(1_i64 << 40)..1 << 40) {
        let pairs: Vec<Pair> = units.iter().map(|units| units.pair()).collect();
        let shift = shift as f64 * UNIT;
        let shifted = mapped(&pairs, |value| value + shift);
        let mean = units[0].estimate as f64 * UNIT;
        for (metric, there) in every_metric(mean).into_iter().zip(every_metric(mean + shift)) {
            if metric != Metric::MedianPercentError {
                let (here, there) = (scored(metric, &pairs), scored(there, &shifted));
                prop_assert!(agree(&here, &there, PROMISED), "{metric:?}: {here:?} {there:?}");
            }
        }
    }

    #[test]
    fn scales_scale_errors_alone(pairs in any_pairs(), scale in 0.01..100.0_f64) {
        let scaled = mapped(&pairs, |value| value * scale);
        for (metric, there) in every_metric(0.3).into_iter().zip(every_metric(0.3 * scale)) {
            let expected = scored(metric, &pairs).map(|mut score| {
                if matches!(metric, Metric::Mae | Metric::Rmse) {
                    score.value *= scale;
                }
                score
            });
            // The scaling rounds, and R² near zero feels it in full.
            let found = scored(there, &scaled);
            let close = match (&expected, &found) {
                (Ok(expected), Ok(found)) => {
                    (expected.value - found.value).abs() <= 1e-9 * expected.value.abs().max(1.0)
                }
                _ => agree(&expected, &found, PROMISED),
            };
            prop_assert!(close, "{metric:?}: {expected:?} {found:?}");
        }
    }

    #[test]
    fn perfect_estimates_score_perfectly(pairs in any_pairs()) {
        let perfect: Vec<Pair> = pairs.iter().map(|pair| Pair { estimate: pair.truth, ..*pair }).collect();
        let expected = [1.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        for (metric, expected) in every_metric(0.3).into_iter().zip(expected) {
            if let Ok(score) = scored(metric, &perfect) {
                prop_assert_eq!(score.value, expected);
            }
        }
    }

    /// Ranks counted pair by pair, and the correlation of their definition.
    #[test]
    fn spearman_equals_brute_force(values in prop::collection::vec((0..9_i32, 0..9_i32), 2..40)) {
        let rank = |of: i32, all: &dyn Fn(&(i32, i32)) -> i32| -> f64 {
            let below = values.iter().filter(|&value| all(value) < of).count();
            let equal = values.iter().filter(|&value| all(value) == of).count();
            below as f64 + 0.5 * (equal as f64 + 1.0)
        };
        let mean = 0.5 * (values.len() as f64 + 1.0);
        let ranks = values.iter().map(|&(truth, estimate)| {
            (rank(truth, &|value| value.0) - mean, rank(estimate, &|value| value.1) - mean)
        });
        let [tt, te, ee] = ranks.fold([0.0; 3], |[tt, te, ee], (t, e)| [tt + t * t, te + t * e, ee + e * e]);
        let pairs: Vec<Pair> = values
            .iter()
            .map(|&(truth, estimate)| Pair { truth: truth.into(), estimate: estimate.into() })
            .collect();
        match scored(Metric::Spearman, &pairs) {
            Ok(score) => prop_assert!((score.value - te / (tt * ee).sqrt()).abs() <= 1e-14),
            Err(reason) => prop_assert!(tt == 0.0 || ee == 0.0, "{reason}"),
        }
    }

    #[test]
    fn median_equals_that_of_the_sorted(pairs in any_pairs(), zeros in 0..4_usize) {
        let mut percent: Vec<f64> = pairs
            .iter()
            .map(|pair| 100.0 * (pair.truth - pair.estimate).abs() / pair.truth.abs())
            .collect();
        percent.sort_by(f64::total_cmp);
        let half = percent.len() / 2;
        let expected = if percent.len() % 2 == 1 {
            percent[half]
        } else {
            f64::midpoint(percent[half - 1], percent[half])
        };
        let mut with_zeros = pairs.clone();
        with_zeros.resize(pairs.len() + zeros, Pair { truth: 0.0, estimate: 3.0 });
        let score = scored(Metric::MedianPercentError, &with_zeros).expect("truths other than zero");
        prop_assert!(relative_error(score.value, expected) <= KEPT);
        prop_assert_eq!((score.samples, score.zero_truths), (pairs.len(), zeros));
    }
}
