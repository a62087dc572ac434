//! Intervals over units and reruns, against closed forms and known distributions.

use proptest::prelude::*;
use sps_metrics::{
    IntervalError, Intervals, Level, Metric, Samples, ScoreInterval, Scored, Undefined,
};

use crate::support::{assert_close, samples, training_mean, uniform};

const OF_MODELS: Intervals = Intervals::of_models(Level::P95);
const OF_TRAINING: Intervals = Intervals::of_training(Level::P95);

fn scored<'a>(metric: Metric, truth: &'a [f64], estimate: &'a [f64]) -> Scored<'a> {
    Scored::new(metric, samples(truth, estimate))
}

/// Of samples that come from these units.
fn by_units(units: &[usize], scored: Scored<'_>) -> ScoreInterval {
    let scored = Scored {
        units: Some(units),
        ..scored
    };
    let found = OF_MODELS.interval(&[scored]);
    found.expect("two units or more")
}

/// Of each rerun.
fn numbered<'a>(metric: Metric, truth: &'a [f64], estimates: &'a [Vec<f64>]) -> Vec<Scored<'a>> {
    let reruns = estimates.iter().enumerate();
    let scored = reruns.map(|(rerun, estimate)| Scored {
        rerun,
        ..scored(metric, truth, estimate)
    });
    scored.collect()
}

fn draw(numbers: &mut impl Iterator<Item = f64>, count: usize) -> Vec<f64> {
    numbers.by_ref().take(count).collect()
}

fn plus(left: &[f64], right: &[f64]) -> Vec<f64> {
    let both = left.iter().zip(right);
    both.map(|(left, right)| left + right).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// With n - 1 in its denominator.
fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    let squares = values.iter().map(|value| (value - mean).powi(2));
    squares.sum::<f64>() / (values.len() - 1) as f64
}

proptest! {
    /// The mean of absolute errors has the variance s² / n of any mean, and with reruns that of
    /// their means besides; the difference of two methods that of the differences.
    #[test]
    fn variances_of_means_are_the_closed_forms(
        errors in prop::collection::vec(prop::collection::vec(0.5_f64..8.0, 9), 2..6),
        share in 0.0_f64..0.5,
    ) {
        let truth = [64.0; 9];
        let estimates: Vec<Vec<f64>> = errors.iter().map(|errors| plus(&truth, errors)).collect();
        let reruns = numbered(Metric::Mae, &truth, &estimates);
        let of_unit: Vec<f64> = (0..9).map(|unit| {
            mean(&errors.iter().map(|errors| errors[unit]).collect::<Vec<_>>())
        }).collect();
        let of_rerun: Vec<f64> = errors.iter().map(|errors| mean(errors)).collect();
        let units = (1.0 + share) * variance(&of_unit) / 9.0;
        let trainings = variance(&of_rerun) / errors.len() as f64;
        let close = |found: &ScoreInterval, expected: f64| {
            (found.standard_error / expected.sqrt() - 1.0).abs() < 1e-9
        };
        let found = OF_TRAINING.sharing(share).interval(&reruns).expect("nine units");
        prop_assert!(close(&found, units + trainings), "{found:?}");
        prop_assert_eq!([found.units, found.reruns], [9, errors.len()]);
        let found = OF_MODELS.sharing(share).interval(&reruns).expect("nine units");
        prop_assert!(close(&found, units), "{found:?}");

        let first = [scored(Metric::Mae, &truth, &estimates[0])];
        let second = [scored(Metric::Mae, &truth, &estimates[1])];
        let apart: Vec<f64> = errors[0].iter().zip(&errors[1]).map(|(a, b)| a - b).collect();
        let found = OF_MODELS.difference(&first, &second).expect("nine units");
        prop_assert!(close(&found, variance(&apart) / 9.0), "{found:?}");
        let found = OF_MODELS.independent_difference(&first, &second).expect("nine units");
        let both = variance(&errors[0]) / 9.0 + variance(&errors[1]) / 9.0;
        prop_assert!(close(&found, both), "{found:?}");
    }

    /// A change without a unit is the score without it less the score, of any metric that is smooth and
    /// of units of any size; a standard error is at least that of the jackknife.
    #[test]
    fn leaving_out_is_scoring_without(
        samples in prop::collection::vec((1.0_f64..9.0, 1.0_f64..9.0, 0..5_usize), 12..30),
    ) {
        let units: Vec<usize> = samples.iter().map(|sample| 7 * sample.2).collect();
        let part = |without: Option<usize>| -> (Vec<f64>, Vec<f64>) {
            let kept = samples.iter().filter(|sample| Some(7 * sample.2) != without);
            kept.map(|&(truth, estimate, _)| (truth, estimate)).unzip()
        };
        let mut different = units.clone();
        different.sort_unstable();
        different.dedup();
        prop_assume!(different.len() > 1);
        for metric in [
            Metric::R2(training_mean(4.0)),
            Metric::R2OwnMean,
            Metric::Mae,
            Metric::Rmse,
        ] {
            let (truth, estimate) = part(None);
            let whole = scored(metric, &truth, &estimate);
            let changes: Option<Vec<f64>> = different.iter().map(|&unit| {
                let (truth, estimate) = part(Some(unit));
                let score = metric.score(Samples { truth: &truth, estimate: &estimate });
                Some(score.ok()?.value)
            }).collect();
            let Some(changes) = changes else { continue };
            let count = changes.len() as f64;
            let expected = (variance(&changes) * (count - 1.0).powi(2) / count).sqrt();
            let found = by_units(&units, whole);
            prop_assert!(found.standard_error > expected * (1.0 - 1e-9) - 1e-12);
        }
    }

    /// A unit photographed twice as often, each photograph twice, says nothing more; nor does another
    /// order, or other numbers.
    #[test]
    fn samples_repeated_within_their_unit_change_nothing(
        samples in prop::collection::vec((1.0_f64..9.0, 1.0_f64..9.0), 12..30),
        times in 2_usize..5,
    ) {
        let (truth, estimate): (Vec<f64>, Vec<f64>) = samples.iter().copied().unzip();
        let repeated = |values: &[f64]| values.repeat(times);
        let units: Vec<usize> = (0..truth.len()).map(|at| usize::MAX - 13 * at).collect();
        let units = units.repeat(times);
        for metric in [
            Metric::R2(training_mean(4.0)),
            Metric::R2OwnMean,
            Metric::Mae,
            Metric::Rmse,
            Metric::Spearman,
        ] {
            let once = OF_MODELS.interval(&[scored(metric, &truth, &estimate)]);
            let (truth, estimate) = (repeated(&truth), repeated(&estimate));
            let often = by_units(&units, scored(metric, &truth, &estimate));
            let once = once.expect("twelve units");
            for (a, b) in [(once.low, often.low), (once.high, often.high)] {
                prop_assert!((a - b).abs() < 1e-9 * a.abs().max(1.0), "{metric:?}: {a} {b}");
            }
        }
    }
}

/// Counts how often intervals hold a value known in closed form. Of 800 intervals at 95 % three
/// standard errors are 2.3 %, and intervals may be two points short.
fn assert_covered(
    name: &str,
    known: f64,
    interval: impl Fn(&mut dyn Iterator<Item = f64>) -> ScoreInterval,
) {
    const TRIALS: usize = 800;
    let mut numbers = uniform(name);
    let trials = (0..TRIALS).map(|_| interval(&mut numbers));
    let covered = trials.filter(|found| found.low <= known && known <= found.high);
    let share = covered.count() as f64 / TRIALS as f64;
    assert!((0.93 - 0.023..=0.995).contains(&share), "{name}: {share}");
}

/// E|u| = 1/2 and √E u² = 1/√3 for u uniform on [-1, 1); with t = 3u, e = u', m = 1/2 R² is
/// 1 - E u'² / E (t - m)² = 1 - (1/3) / (9/3 + 1/4); the median of 100 |e| / 2 is 25; truth and
/// estimate that have nothing to do with one another have no correlation.
#[test]
fn scores_of_one_model_are_covered() {
    let r2 = 1.0 - (1.0 / 3.0) / (3.0 + 0.25);
    for units in [20, 41, 200] {
        for (name, metric, known) in [
            ("mae", Metric::Mae, 0.5),
            ("rmse", Metric::Rmse, (1.0_f64 / 3.0).sqrt()),
            ("r2", Metric::R2(training_mean(0.5)), r2),
            ("r2_own_mean", Metric::R2OwnMean, 1.0 - 1.0 / 9.0),
            ("median", Metric::MedianPercentError, 25.0),
            ("Spearman", Metric::Spearman, 0.0),
        ] {
            assert_covered(&format!("{name}, {units}"), known, |mut numbers| {
                let truth: Vec<f64> = match metric {
                    Metric::MedianPercentError => vec![2.0; units],
                    Metric::Spearman => draw(&mut numbers, units),
                    _ => draw(&mut numbers, units).iter().map(|u| 3.0 * u).collect(),
                };
                let drawn = draw(&mut numbers, units);
                let estimate = match metric {
                    Metric::Spearman => drawn,
                    _ => plus(&truth, &drawn),
                };
                let found = OF_MODELS.interval(&[scored(metric, &truth, &estimate)]);
                found.expect("20 units or more")
            });
        }
    }
}

/// Errors a + b + c of a unit, a rerun and both: each rerun draws all estimates by b. Squared errors
/// are E a² + E b² + E c², for truths with E t² = 3.
#[test]
fn units_and_reruns_are_covered_together() {
    for reruns in [3, 5, 10] {
        for by_rerun in [0.0, 0.1, 0.3] {
            let known = 1.0 - (0.25 / 3.0 + by_rerun * by_rerun / 3.0 + 0.04 / 3.0) / 3.0;
            let name = format!("R², {reruns} reruns that differ by {by_rerun}");
            assert_covered(&name, known, |mut numbers| {
                const UNITS: usize = 60;
                let truth: Vec<f64> = draw(&mut numbers, UNITS).iter().map(|u| 3.0 * u).collect();
                let of_units: Vec<f64> =
                    draw(&mut numbers, UNITS).iter().map(|u| u / 2.0).collect();
                let estimates: Vec<Vec<f64>> = (0..reruns)
                    .map(|_| {
                        let of_rerun = by_rerun * draw(&mut numbers, 1)[0];
                        let of_both = draw(&mut numbers, UNITS);
                        let errors = of_units.iter().zip(of_both);
                        let errors = errors.map(|(unit, both)| unit + of_rerun + 0.2 * both);
                        plus(&truth, &errors.collect::<Vec<_>>())
                    })
                    .collect();
                let metric = Metric::R2(training_mean(0.0));
                let found = OF_TRAINING.interval(&numbered(metric, &truth, &estimates));
                found.expect("60 units")
            });
        }
    }
}

/// Errors u and 0.8 u + 0.2 u': MSE 1/3 and (0.64 + 0.04) / 3; R² about 0 with E t² = 3.
#[test]
fn the_difference_of_two_methods_is_covered() {
    let known = (0.68 / 3.0 - 1.0 / 3.0) / 3.0;
    assert_covered("difference", known, |mut numbers| {
        let truth: Vec<f64> = draw(&mut numbers, 80).iter().map(|u| 3.0 * u).collect();
        let errors = draw(&mut numbers, 80);
        let other = draw(&mut numbers, 80);
        let mixed = errors.iter().zip(&other).map(|(u, v)| 0.8 * u + 0.2 * v);
        let (first, second) = (
            plus(&truth, &errors),
            plus(&truth, &mixed.collect::<Vec<f64>>()),
        );
        let metric = Metric::R2(training_mean(0.0));
        let [first, second] = [&first, &second].map(|estimate| [scored(metric, &truth, estimate)]);
        OF_MODELS.difference(&first, &second).expect("80 units")
    });
}

/// Ten photographs of a surface share all of their error. Counting photographs as if they were
/// surfaces makes intervals a third as wide.
#[test]
fn a_unit_counts_once_however_many_samples_it_has() {
    let mut numbers = uniform("surfaces");
    let truth = vec![50.0; 600];
    let shared = draw(&mut numbers, 60);
    let errors: Vec<f64> = shared.iter().flat_map(|shared| [*shared; 10]).collect();
    let estimate = plus(&truth, &errors);
    let units: Vec<usize> = (0..600).map(|at| at / 10).collect();
    let one = scored(Metric::Mae, &truth, &estimate);
    let by_photograph = OF_MODELS.interval(&[one]).expect("600 samples");
    let by_unit = by_units(&units, one);
    assert_eq!((by_unit.units, by_photograph.units), (60, 600));
    let times = by_unit.standard_error / by_photograph.standard_error;
    assert_close(times, (10.0 * 599.0 / 590.0_f64).sqrt(), 1e-9);
}

#[test]
fn what_is_the_same_for_all_units_and_reruns_has_no_width() {
    let mut numbers = uniform("paired");
    let truth = draw(&mut numbers, 50);
    let small = draw(&mut numbers, 50);
    // Every error one larger: the difference is one, whichever units are left out.
    let large: Vec<f64> = small.iter().map(|error| error + error.signum()).collect();
    let (first, second) = (plus(&truth, &large), plus(&truth, &small));
    let (first, second) = (vec![first; 3], vec![second; 3]);
    let [first, second] = [&first, &second].map(|all| numbered(Metric::Mae, &truth, all));
    let found = OF_TRAINING.difference(&first, &second);
    let found = found.expect("50 units");
    for end in [found.low, found.estimate, found.high] {
        assert!((end - 1.0).abs() < 1e-9, "{found:?}");
    }
    assert!(found.excludes_zero() && found.p < 1e-9);
    let none = OF_TRAINING.difference(&first, &first);
    let none = none.expect("50 units");
    assert_eq!(
        (none.low, none.estimate, none.high, none.p),
        (0.0, 0.0, 0.0, 1.0)
    );
}

/// A method with two reruns beside one with three: each has its own variance.
#[test]
fn reruns_that_are_not_the_same_are_not_paired() {
    let truth = [0.0; 8];
    let reruns =
        |errors: &[f64]| -> Vec<Vec<f64>> { errors.iter().map(|error| vec![*error; 8]).collect() };
    let (few, many) = (reruns(&[1.0, 2.0]), reruns(&[1.0, 2.0, 6.0]));
    let expected = variance(&[1.0, 2.0]) / 2.0 + variance(&[1.0, 2.0, 6.0]) / 3.0;
    let [few, many] = [&few, &many].map(|all| numbered(Metric::Mae, &truth, all));
    let found = OF_TRAINING.difference(&many, &few).expect("eight units");
    assert_close(found.standard_error, expected.sqrt(), 1e-9);
    assert_eq!(found.estimate, 1.5);
}

#[test]
fn ends_stay_where_a_score_can_lie() {
    let truth = [1.0, 2.0, 3.0, 4.0, 9.0];
    let estimate = [1.1, 2.0, 2.9, 4.4, 5.0];
    let ends = |metric| {
        let found = OF_MODELS.interval(&[scored(metric, &truth, &estimate)]);
        found
            .map(|found| [found.low, found.high])
            .expect("five units")
    };
    let [low, high] = ends(Metric::R2OwnMean);
    assert!(low < 0.0 && high < 1.0, "{low} {high}");
    for metric in [Metric::Mae, Metric::Rmse, Metric::MedianPercentError] {
        let [low, _] = ends(metric);
        assert!(low >= 0.0, "{metric:?}: {low}");
    }
    let mixed = [1.1, 2.0, 2.9, 9.4, 5.0];
    let found = OF_MODELS.interval(&[scored(Metric::Spearman, &truth, &mixed)]);
    let found = found.expect("five units");
    assert!(-1.0 < found.low && found.high < 1.0, "{found:?}");
    // A perfect score has nothing that varies.
    let perfect = OF_MODELS.interval(&[scored(Metric::R2OwnMean, &truth, &truth)]);
    let perfect = perfect.expect("five units");
    assert_eq!((perfect.low, perfect.high), (1.0, 1.0));
}

#[test]
fn what_has_no_interval_says_why() {
    let truth = [1.0, 2.0, 3.0];
    let estimate = [1.5, 2.0, 2.0];
    let good = scored(Metric::Mae, &truth, &estimate);
    let one_unit = Scored {
        units: Some(&[7, 7, 7]),
        ..good
    };
    let unpaired = Scored {
        units: Some(&[7, 8]),
        ..good
    };
    let constant = scored(Metric::R2OwnMean, &[4.0; 3], &estimate);
    let alone = scored(Metric::R2OwnMean, &[4.0, 4.0, 5.0], &estimate);
    let unequal = scored(Metric::Mae, &truth, &estimate[..2]);
    let unequal_lengths = Undefined::LengthMismatch {
        truths: 3,
        estimates: 2,
    };
    let unequal_units = IntervalError::UnitMismatch {
        samples: 3,
        units: 2,
    };
    for (scored, reason) in [
        (one_unit, IntervalError::OneUnit),
        (unpaired, unequal_units),
        (constant, Undefined::ConstantTruth { value: 4.0 }.into()),
        (alone, IntervalError::OneUnit),
        (unequal, unequal_lengths.into()),
    ] {
        assert_eq!(OF_MODELS.interval(&[scored]), Err(reason));
    }
    assert_eq!(OF_MODELS.interval(&[]), Err(Undefined::Empty.into()));
    let reason = IntervalError::TooFewReruns { found: 1 };
    assert_eq!(OF_TRAINING.interval(&[good, good]), Err(reason.clone()));
    assert_eq!(OF_TRAINING.difference(&[good], &[good]), Err(reason));
}

/// Half of the samples are of one unit, as many may be of one kind of material. Without it R² about the
/// own mean is the same: truths of -1 and 1 with errors of 1/2 have 1 - (1/4) / 1, and with as many
/// truths of 2 with errors of √(1/2) besides they have 1 - (1/4 + 1/2) / (1 + 2). With the weight w of
/// that unit it is 1 - (1/4 + w/2) / (1 + 4 w / (1 + w)), whose derivative at 1 is -1/12: another such unit
/// would change the score by as much, and the standard error may not be less.
#[test]
fn a_unit_that_is_much_of_all_widens_an_interval() {
    let others: Vec<usize> = (1..13).flat_map(|unit| [unit; 4]).collect();
    let units = [vec![0; 48], others].concat();
    let truth: Vec<f64> = (0..96)
        .map(|at| match at {
            0..48 => 2.0,
            _ if at % 2 == 0 => 1.0,
            _ => -1.0,
        })
        .collect();
    let error = |&unit: &usize| if unit == 0 { 0.5_f64.sqrt() } else { 0.5 };
    let estimate = plus(&truth, &units.iter().map(error).collect::<Vec<f64>>());
    let found = by_units(&units, scored(Metric::R2OwnMean, &truth, &estimate));
    assert_close(found.estimate, 0.75, 1e-12);
    assert!(found.standard_error >= 1.0 / 12.0, "{found:?}");
}
