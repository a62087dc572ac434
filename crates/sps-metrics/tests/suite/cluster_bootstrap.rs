//! Intervals over units of several samples each, against closed forms.

use proptest::prelude::*;
use sps_metrics::{Bootstrap, BootstrapInterval, Level, Metric, Samples, Scored};

use crate::support::{training_mean, uniform};

/// Absolute errors, unit by unit, as samples whose truth is `TRUTH`.
const TRUTH: f64 = 64.0;

/// Estimates and unit numbers, the samples of different units mixed.
fn mixed(units: &[Vec<f64>]) -> (Vec<f64>, Vec<usize>) {
    let longest = units.iter().map(Vec::len).max().unwrap_or(0);
    let (mut estimates, mut numbers) = (Vec::new(), Vec::new());
    for place in 0..longest {
        for (unit, errors) in units.iter().enumerate() {
            if let Some(error) = errors.get(place) {
                estimates.push(TRUTH + error);
                numbers.push(1000 - 13 * unit);
            }
        }
    }
    (estimates, numbers)
}

fn mae_interval(bootstrap: &Bootstrap, units: &[Vec<f64>], clustered: bool) -> BootstrapInterval {
    let (estimate, numbers) = mixed(units);
    let truth = vec![TRUTH; estimate.len()];
    let found = bootstrap.interval(&Scored {
        metric: Metric::Mae,
        samples: Samples {
            truth: &truth,
            estimate: &estimate,
        },
        units: clustered.then_some(&numbers),
    });
    found.expect("two units or more")
}

/// The mean absolute error of every one of the G^G resamples of G units, ascending.
fn enumerated(units: &[Vec<f64>]) -> Vec<f64> {
    let count = units.len();
    let of = |mut resample: usize| {
        let (mut sum, mut samples) = (0.0, 0);
        for _ in 0..count {
            let drawn = &units[resample % count];
            resample /= count;
            sum += drawn.iter().sum::<f64>();
            samples += drawn.len();
        }
        sum / samples as f64
    };
    let mut values: Vec<f64> = (0..count.pow(count as u32)).map(of).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// What sums in another order may differ by.
const ROUNDING: f64 = 1e-12;

fn units_of(sizes: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Vec<f64>>> {
    let unit = prop::collection::vec(0.0_f64..8.0, 1..4);
    prop::collection::vec(unit, sizes)
}

proptest! {
    /// Of two to four units of any sizes: the ends are scores that a resample can have, and lie
    /// where the enumerated distribution has its quantiles.
    #[test]
    fn ends_are_quantiles_of_all_resamples(
        units in units_of(2..5),
        seed in 0_u64..8,
        tail in prop::sample::select(vec![0.05, 0.1, 0.25]),
    ) {
        const RESAMPLES: usize = 4000;
        let level = Level::new(1.0 - 2.0 * tail).expect("between 0 and 1");
        let bootstrap = Bootstrap::new(seed).with_resamples(RESAMPLES).with_level(level);
        let found = mae_interval(&bootstrap, &units, true);
        let all = enumerated(&units);
        prop_assert_eq!(found.units, units.len());
        for end in [found.low, found.high] {
            let nearest = all.iter().map(|value| (value - end).abs()).fold(f64::MAX, f64::min);
            prop_assert!(nearest < ROUNDING, "{end} is none of {all:?}");
        }
        let share = |holds: &dyn Fn(f64) -> bool| {
            all.iter().filter(|&&value| holds(value)).count() as f64 / all.len() as f64
        };
        // Five standard errors of a share among the resamples.
        let slack = 5.0 * (tail * (1.0 - tail) / RESAMPLES as f64).sqrt();
        prop_assert!(share(&|value| value < found.low - ROUNDING) <= tail + slack);
        prop_assert!(share(&|value| value <= found.low + ROUNDING) >= tail - slack);
        prop_assert!(share(&|value| value > found.high + ROUNDING) <= tail + slack);
        prop_assert!(share(&|value| value >= found.high - ROUNDING) >= tail - slack);
    }

    /// A unit photographed twice as often, each photograph twice, says nothing more.
    #[test]
    fn samples_repeated_within_their_unit_change_nothing(
        units in prop::collection::vec(prop::collection::vec((1.0_f64..9.0, 1.0_f64..9.0), 1..4), 8..14),
        times in 2_usize..5,
        seed: u64,
    ) {
        let flat: Vec<(f64, f64, usize)> = units
            .iter()
            .enumerate()
            .flat_map(|(unit, pairs)| pairs.iter().map(move |&(t, e)| (t, e, unit)))
            .collect();
        for metric in [
            Metric::Mae,
            Metric::Rmse,
            Metric::R2(training_mean(4.0)),
            Metric::R2OwnMean,
            Metric::MedianPercentError,
            Metric::Spearman,
        ] {
            let interval = |samples: &[(f64, f64, usize)]| {
                let truth: Vec<f64> = samples.iter().map(|sample| sample.0).collect();
                let estimate: Vec<f64> = samples.iter().map(|sample| sample.1).collect();
                let numbers: Vec<usize> = samples.iter().map(|sample| sample.2).collect();
                let scored = Scored {
                    metric,
                    samples: Samples { truth: &truth, estimate: &estimate },
                    units: Some(&numbers),
                };
                Bootstrap::new(seed).with_resamples(199).interval(&scored)
            };
            let (once, repeated) = (interval(&flat), interval(&flat.repeat(times)));
            let (once, repeated) = (once.expect("8 units"), repeated.expect("8 units"));
            for (a, b) in [
                (once.low, repeated.low),
                (once.estimate, repeated.estimate),
                (once.high, repeated.high),
            ] {
                prop_assert!((a - b).abs() < 1e-9 * (1.0 + a.abs()), "{metric:?}: {a} {b}");
            }
        }
    }

    /// In each unit the errors average two, though no error is two. With all members of a unit, or
    /// none, every resample has two; with some of them, hardly any.
    #[test]
    fn members_of_a_unit_are_drawn_together(
        offs in prop::collection::vec(prop::collection::vec(0.1_f64..1.9, 1..4), 2..12),
        seed: u64,
    ) {
        let units: Vec<Vec<f64>> = offs
            .iter()
            .map(|offs| offs.iter().flat_map(|off| [2.0 - off, 2.0 + off]).collect())
            .collect();
        let bootstrap = Bootstrap::new(seed).with_resamples(99);
        let together = mae_interval(&bootstrap, &units, true);
        prop_assert!((together.low - 2.0).abs() < ROUNDING, "{together:?}");
        prop_assert!((together.high - 2.0).abs() < ROUNDING, "{together:?}");
        let apart = mae_interval(&bootstrap, &units, false);
        prop_assert!(apart.width() > 1e-3, "{apart:?}: the test would not see it");
    }

    /// The errors of two properties of a unit average two, whichever of its samples each has: where
    /// a unit is drawn for one property, it is drawn for the other.
    #[test]
    fn properties_of_a_unit_are_drawn_together(
        offs in prop::collection::vec(-1.9_f64..1.9, 2..12),
        members in 1_usize..4,
        seed: u64,
    ) {
        let of = |sign: f64, members: usize| -> Vec<Vec<f64>> {
            offs.iter().map(|off| vec![2.0 + sign * off; members]).collect()
        };
        let (first, second) = (mixed(&of(1.0, members)), mixed(&of(-1.0, 2)));
        let truth = [TRUTH; 40];
        let columns = [&first, &second].map(|(estimate, numbers)| Scored {
            metric: Metric::Mae,
            samples: Samples { truth: &truth[..estimate.len()], estimate },
            units: Some(numbers),
        });
        let found = Bootstrap::new(seed).mean_interval(&columns);
        let found = found.expect("two units or more");
        prop_assert_eq!(found.units, offs.len());
        prop_assert!((found.low - 2.0).abs() < ROUNDING, "{found:?}");
        prop_assert!((found.high - 2.0).abs() < ROUNDING, "{found:?}");
    }
}

/// With G units of equal size the mean over a resample of them has the variance
/// `sum_g (m_g - m)^2 / G^2`, m_g being the unit's mean and m theirs. At G = 40 it is close to
/// normal, and half of the 95 % interval is 1.96 of its deviations.
#[test]
fn half_the_width_is_that_of_the_closed_form() {
    const UNITS: usize = 40;
    const MEMBERS: usize = 6;
    for trial in 0..6 {
        let mut numbers = uniform(&format!("cluster-bootstrap/{trial}"));
        let mut number = || numbers.next().expect("endless");
        let units: Vec<Vec<f64>> = (0..UNITS)
            .map(|_| {
                let shared = 4.0 + number();
                (0..MEMBERS).map(|_| shared + 0.4 * number()).collect()
            })
            .collect();
        let means: Vec<f64> = units
            .iter()
            .map(|unit| unit.iter().sum::<f64>() / MEMBERS as f64)
            .collect();
        let mean = means.iter().sum::<f64>() / UNITS as f64;
        let squares: f64 = means.iter().map(|m| (m - mean).powi(2)).sum();
        let expected = 1.959_964 * squares.sqrt() / UNITS as f64;

        let bootstrap = Bootstrap::new(trial).with_resamples(20_000);
        let half = mae_interval(&bootstrap, &units, true).width() / 2.0;
        // The two quantiles of 20 000 resamples are known to 1 %, the rest is what is not normal.
        assert!((half / expected - 1.0).abs() < 0.04, "{half} {expected}");
        let apart = mae_interval(&bootstrap, &units, false).width() / 2.0;
        assert!(apart < 0.6 * expected, "{apart}: the test would not see it");
    }
}
