//! Intervals over surfaces.

use sps_metrics::{
    Bootstrap, BootstrapError, BootstrapInterval, Compared, Level, Metric, Samples, Scored,
    Undefined,
};

use crate::support::{training_mean, uniform};

fn scored<'a>(metric: Metric, truth: &'a [f64], estimate: &'a [f64]) -> Scored<'a> {
    Scored {
        metric,
        samples: Samples { truth, estimate },
        units: None,
    }
}

fn draw(numbers: &mut impl Iterator<Item = f64>, count: usize) -> Vec<f64> {
    numbers.by_ref().take(count).collect()
}

fn plus(left: &[f64], right: &[f64]) -> Vec<f64> {
    left.iter()
        .zip(right)
        .map(|(left, right)| left + right)
        .collect()
}

/// All 4^4 resamples of four surfaces are equally likely: the ends must lie where their
/// distribution says.
#[test]
fn ends_match_the_enumerated_distribution() {
    let errors = [1.0, 2.0, 4.0, 8.0];
    let truth = [10.0, 20.0, 30.0, 40.0];
    let estimate = plus(&truth, &errors);
    let mut all = Vec::new();
    for resample in 0..256_usize {
        let drawn = (0..4).map(|place| errors[resample >> (2 * place) & 3]);
        all.push(drawn.sum::<f64>() / 4.0);
    }
    let share = |holds: &dyn Fn(f64) -> bool| {
        all.iter().filter(|&&mean| holds(mean)).count() as f64 / all.len() as f64
    };
    for thousandths in [500, 700, 800, 900, 950] {
        let level = Level::new(f64::from(thousandths) / 1000.0).expect("between 0 and 1");
        let bootstrap = Bootstrap::new(3).with_resamples(40_000).with_level(level);
        let found = bootstrap.interval(&scored(Metric::Mae, &truth, &estimate));
        let BootstrapInterval { low, high, .. } = found.expect("four surfaces");
        let tail = (1.0 - level.get()) / 2.0;
        // Four standard errors of a share among 40 000 draws.
        let slack = 4.0 * (tail * (1.0 - tail) / 40_000.0).sqrt();
        assert!(share(&|mean| mean < low) <= tail + slack, "{thousandths}");
        assert!(share(&|mean| mean <= low) >= tail - slack, "{thousandths}");
        assert!(share(&|mean| mean > high) <= tail + slack, "{thousandths}");
        assert!(share(&|mean| mean >= high) >= tail - slack, "{thousandths}");
    }
}

/// Counts how often intervals hold a value known in closed form. Of 600 intervals at 95 %, four
/// standard errors are 3.6 %; the percentile bootstrap itself falls short by about 1 % at 80
/// surfaces.
fn covered(
    name: &str,
    known: f64,
    interval: impl Fn(&mut dyn Iterator<Item = f64>) -> BootstrapInterval,
) -> f64 {
    const TRIALS: usize = 600;
    let mut numbers = uniform(name);
    let trials = (0..TRIALS).map(|_| interval(&mut numbers));
    let covered = trials.filter(|found| found.low <= known && known <= found.high);
    covered.count() as f64 / TRIALS as f64
}

const QUICK: Bootstrap = Bootstrap::new(11).with_resamples(999);
const COVERED: std::ops::RangeInclusive<f64> = 0.91..=0.98;

#[test]
fn mae_of_uniform_errors_is_covered() {
    // E|u| = 1/2 for u uniform on [-1, 1).
    let fraction = covered("coverage/mae", 0.5, |mut numbers| {
        let truth = draw(&mut numbers, 80);
        let estimate = plus(&truth, &draw(&mut numbers, 80));
        let found = QUICK.interval(&scored(Metric::Mae, &truth, &estimate));
        found.expect("80 surfaces")
    });
    assert!(COVERED.contains(&fraction), "{fraction}");
}

#[test]
fn r2_about_the_training_mean_is_covered() {
    // t = 3u, e = u', m = 1/2: R² = 1 - E u'² / E (t - m)² = 1 - (1/3) / (9/3 + 1/4).
    let known = 1.0 - (1.0 / 3.0) / (3.0 + 0.25);
    let fraction = covered("coverage/r2", known, |mut numbers| {
        let truth: Vec<f64> = draw(&mut numbers, 80).iter().map(|u| 3.0 * u).collect();
        let estimate = plus(&truth, &draw(&mut numbers, 80));
        let metric = Metric::R2(training_mean(0.5));
        let found = QUICK.interval(&scored(metric, &truth, &estimate));
        found.expect("80 surfaces")
    });
    assert!(COVERED.contains(&fraction), "{fraction}");
}

#[test]
fn median_percent_error_is_covered() {
    // 100 |e| / |t| with |t| = 2, e uniform: the median of 50 |u| is 25.
    let fraction = covered("coverage/median", 25.0, |mut numbers| {
        let truth = vec![2.0; 81];
        let estimate = plus(&truth, &draw(&mut numbers, 81));
        let found = QUICK.interval(&scored(Metric::MedianPercentError, &truth, &estimate));
        found.expect("81 surfaces")
    });
    assert!(COVERED.contains(&fraction), "{fraction}");
}

#[test]
fn the_difference_of_two_methods_is_covered() {
    // Errors u and 0.8 u + 0.2 u': MSE 1/3 and (0.64 + 0.04) / 3; R² about 0 with E t² = 3.
    let known = (0.68 / 3.0 - 1.0 / 3.0) / 3.0;
    let fraction = covered("coverage/difference", known, |mut numbers| {
        let truth: Vec<f64> = draw(&mut numbers, 80).iter().map(|u| 3.0 * u).collect();
        let errors = draw(&mut numbers, 80);
        let other = draw(&mut numbers, 80);
        let mixed = errors.iter().zip(&other).map(|(u, v)| 0.8 * u + 0.2 * v);
        let found = QUICK.difference(&Compared {
            metric: Metric::R2(training_mean(0.0)),
            truth: &truth,
            first: &plus(&truth, &errors),
            second: &plus(&truth, &mixed.collect::<Vec<f64>>()),
            units: None,
        });
        found.expect("80 surfaces")
    });
    assert!(COVERED.contains(&fraction), "{fraction}");
}

/// Ten photographs of a surface share most of their error. Drawing photographs as if they were
/// surfaces gives intervals that are far too narrow; drawing surfaces does not.
#[test]
fn surfaces_are_drawn_with_all_their_samples() {
    const SURFACES: usize = 60;
    const PHOTOGRAPHS: usize = 10;
    let surfaces: Vec<usize> = (0..SURFACES * PHOTOGRAPHS)
        .map(|i| i / PHOTOGRAPHS)
        .collect();
    let trial = |numbers: &mut dyn Iterator<Item = f64>, surfaces: Option<&[usize]>| {
        let mut numbers = numbers;
        let truth = vec![50.0; SURFACES * PHOTOGRAPHS];
        let shared = draw(&mut numbers, SURFACES);
        let errors = shared.iter().flat_map(|shared| [*shared; PHOTOGRAPHS]);
        let estimate = plus(&truth, &errors.collect::<Vec<f64>>());
        let scored = Scored {
            units: surfaces,
            ..scored(Metric::Mae, &truth, &estimate)
        };
        QUICK.interval(&scored).expect("60 surfaces")
    };
    let by_surface = covered("coverage/surfaces", 0.5, |numbers| {
        trial(numbers, Some(&surfaces))
    });
    let by_photograph = covered("coverage/surfaces", 0.5, |numbers| trial(numbers, None));
    assert!(COVERED.contains(&by_surface), "{by_surface}");
    assert!(by_photograph < 0.6, "{by_photograph}");
}

#[test]
fn methods_are_compared_on_the_same_surfaces() {
    let mut numbers = uniform("paired");
    let truth = draw(&mut numbers, 50);
    let small = draw(&mut numbers, 50);
    // Every error one larger: the difference is one on every set of surfaces.
    let large = small.iter().map(|error| error + error.signum());
    let first = plus(&truth, &large.collect::<Vec<f64>>());
    let second = plus(&truth, &small);
    let compared = Compared {
        metric: Metric::Mae,
        truth: &truth,
        first: &first,
        second: &second,
        units: None,
    };
    let bootstrap = Bootstrap::new(5);
    let found = bootstrap.difference(&compared).expect("50 surfaces");
    for end in [found.low, found.estimate, found.high] {
        assert!((end - 1.0).abs() < 1e-14, "{found:?}");
    }
    assert!(found.excludes_zero());

    let same = Compared {
        second: &first,
        metric: Metric::R2OwnMean,
        ..compared
    };
    let found = bootstrap.difference(&same).expect("50 surfaces");
    assert_eq!((found.low, found.estimate, found.high), (0.0, 0.0, 0.0));
    assert!(!found.excludes_zero());
}

#[test]
fn surfaces_may_have_any_numbers_and_properties_may_lack_some() {
    let mut numbers = uniform("numbers");
    let truth = draw(&mut numbers, 30);
    let estimate = plus(&truth, &draw(&mut numbers, 30));
    let bootstrap = Bootstrap::new(2);
    let plain = scored(Metric::Mae, &truth, &estimate);
    let sparse: Vec<usize> = (0..30).map(|i| usize::MAX - 1000 + 7 * i).collect();
    let renamed = Scored {
        units: Some(&sparse),
        ..plain
    };
    let expected = bootstrap.interval(&plain).expect("30 surfaces");
    assert_eq!(bootstrap.interval(&renamed), Ok(expected));
    assert_eq!(expected.units, 30);
    assert_eq!(bootstrap.mean_interval(&[plain, plain]), Ok(expected));

    // The second property was measured on the first twenty surfaces only.
    let partial = scored(Metric::Mae, &truth[..20], &estimate[..20]);
    let mean = bootstrap
        .mean_interval(&[plain, partial])
        .expect("30 surfaces");
    let of_partial = bootstrap.interval(&partial).expect("20 surfaces");
    assert_eq!(mean.units, 30);
    assert!((mean.estimate - f64::midpoint(expected.estimate, of_partial.estimate)).abs() < 1e-15);
    assert!(mean.low < mean.estimate && mean.estimate < mean.high);
}

#[test]
fn the_seed_decides_and_nothing_else() {
    let mut numbers = uniform("seed");
    let truth = draw(&mut numbers, 40);
    let estimate = plus(&truth, &draw(&mut numbers, 40));
    let scored = scored(Metric::R2OwnMean, &truth, &estimate);
    let interval = |seed| Bootstrap::new(seed).interval(&scored).expect("40 surfaces");
    assert_eq!(interval(1), interval(1));
    assert_ne!(interval(1), interval(2));
}

/// Twelve surfaces of two values: 2 / 2^12 of the resamples see one value only and have no R²
/// about their own mean.
#[test]
fn undefined_resamples_are_counted_against_both_ends() {
    let truth: Vec<f64> = (0..12).map(|i| f64::from(i % 2)).collect();
    let estimate: Vec<f64> = (0..12).map(|i| f64::from(i) / 12.0).collect();
    let bootstrap = Bootstrap::new(4).with_resamples(20_000);
    let found = bootstrap.interval(&scored(Metric::R2OwnMean, &truth, &estimate));
    let found = found.expect("few resamples are undefined");
    let expected = 20_000.0 * 2.0 / 4096.0;
    let off = (found.undefined_resamples as f64 - expected).abs();
    assert!(off < 4.0 * expected.sqrt(), "{found:?}");

    // Of five surfaces with one odd one out, a third see one value only.
    let found = bootstrap.interval(&scored(
        Metric::R2OwnMean,
        &[1.0, 1.0, 1.0, 1.0, 2.0],
        &[0.0; 5],
    ));
    match found {
        Err(BootstrapError::UndefinedResamples {
            undefined,
            resamples: 20_000,
            first: Undefined::ConstantTruth { .. },
        }) => {
            let expected = 20_000.0 * (0.8_f64.powi(5) + 0.2_f64.powi(5));
            assert!((undefined as f64 - expected).abs() < 4.0 * expected.sqrt());
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn what_has_no_interval_says_why() {
    let truth = [1.0, 2.0, 3.0];
    let estimate = [1.5, 2.0, 2.0];
    let good = scored(Metric::Mae, &truth, &estimate);
    let bootstrap = Bootstrap::new(1);

    let few = bootstrap.with_resamples(38).interval(&good);
    let reason = BootstrapError::TooFewResamples {
        found: 38,
        needed: 39,
        level: Level::P95,
    };
    assert_eq!(few, Err(reason));
    assert!(bootstrap.with_resamples(39).interval(&good).is_ok());

    let one = bootstrap.interval(&Scored {
        units: Some(&[7, 7, 7]),
        ..good
    });
    assert_eq!(one, Err(BootstrapError::TooFewUnits { found: 1 }));

    let unpaired = bootstrap.interval(&Scored {
        units: Some(&[7, 8]),
        ..good
    });
    let reason = BootstrapError::UnitMismatch {
        samples: 3,
        units: 2,
    };
    assert_eq!(unpaired, Err(reason));

    let undefined = bootstrap.interval(&scored(Metric::R2OwnMean, &[4.0; 3], &estimate));
    assert_eq!(
        undefined,
        Err(Undefined::ConstantTruth { value: 4.0 }.into())
    );
    assert_eq!(bootstrap.mean_interval(&[]), Err(Undefined::Empty.into()));
    let unequal = bootstrap.difference(&Compared {
        metric: Metric::Mae,
        truth: &truth,
        first: &estimate,
        second: &estimate[..2],
        units: None,
    });
    assert!(matches!(
        unequal,
        Err(BootstrapError::Undefined(Undefined::LengthMismatch { .. }))
    ));
}
