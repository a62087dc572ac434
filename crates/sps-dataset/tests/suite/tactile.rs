//! What is made of tactile readings: values out of range, averages and their spread.

use crate::made::{Made, property};
use proptest::prelude::*;
use sps_dataset::{
    Average, DatasetFolder, OutOfRange, PropertyRange, RangePolicy, Reading, Source,
    TactileSettings, TactileTable,
};

const FRS: &str = "fRS";
const CDF: &str = "cDF";

const RANGED: &str =
    "surface,location,repeat,fRS,cDF\na,0,0,-0.5,100\nb,0,0,100.25,0\nc,0,0,,250\n";

#[test]
fn values_out_of_range_are_kept_clamped_or_rejected_and_always_counted() {
    let made = Made::long(RANGED);
    let counts = [
        (property(FRS), OutOfRange { below: 1, above: 1 }),
        (property(CDF), OutOfRange { below: 0, above: 1 }),
    ];
    let column = |dataset: &DatasetFolder, column: usize| -> Vec<Option<f64>> {
        let readings = dataset.tactile().readings.iter();
        readings.map(|reading| reading.values[column]).collect()
    };
    let kept = made.open_with(RangePolicy::Keep).unwrap();
    assert_eq!(kept.out_of_range(), counts);
    assert_eq!(column(&kept, 0), [Some(-0.5), Some(100.25), None]);
    let clamped = made.open_with(RangePolicy::Clamp).unwrap();
    assert_eq!(clamped.out_of_range(), counts);
    assert_eq!(column(&clamped, 0), [Some(0.0), Some(100.0), None]);
    assert_eq!(column(&clamped, 1), [Some(100.0), Some(0.0), Some(100.0)]);
    let rejected = made.open_with(RangePolicy::Reject).unwrap_err();
    let expected = "line 2: fRS of `a` is -0.5, outside 0 to 100, and is to be rejected";
    assert!(rejected.to_string().ends_with(expected), "{rejected}");
}

fn ranged(ranges: &str, table: &str) -> Made {
    Made::new(&format!("[ranges]\n{ranges}"), "tactile.csv", table)
}

#[test]
fn declared_ranges_hold_every_reading_ends_included() {
    let table = "surface,location,repeat,fRS,cDF\na,0,0,0,-7\nb,0,0,100,\n";
    let made = ranged("fRS = [0, 100]\ncDF = [-inf, 0]", table);
    let dataset = made.open().unwrap();
    let range = |dataset: &DatasetFolder, code| {
        let range = dataset.describe(&property(code)).range;
        range.map(PropertyRange::ends)
    };
    assert_eq!(range(&dataset, FRS), Some([0.0, 100.0]));
    assert_eq!(range(&dataset, CDF), Some([f64::NEG_INFINITY, 0.0]));
    assert_eq!(range(&Made::long(table).open().unwrap(), FRS), None);

    let refusal = ranged("fRS = [0, 99.5]", table).refusal();
    let expected = "tactile.csv, line 3: fRS of `b` is 100, outside 0 to 99.5, the range that the \
                    dataset declares";
    assert_eq!(refusal, expected);
}

#[test]
fn what_was_clamped_is_held_to_the_range_as_it_is_then() {
    let made = ranged("fRS = [0.0, 100.0]", RANGED);
    let clamped = made.open_with(RangePolicy::Clamp).unwrap();
    assert_eq!(clamped.out_of_range()[0].1.below, 1);
    let kept = made.open_with(RangePolicy::Keep);
    let message = kept.unwrap_err().to_string();
    assert!(message.contains("line 2: fRS of `a` is -0.5"), "{message}");
}

#[test]
fn ranges_that_are_none_are_refused() {
    let table = "surface,location,repeat,fRS,cDF\na,0,0,1,1\n";
    let refusal = |ranges: &str| ranged(ranges, table).refusal();
    for [ends, shown] in [
        ["[5, 5]", "5 to 5"],
        ["[9, -1]", "9 to -1"],
        ["[0, nan]", "0 to NaN"],
    ] {
        let expected = format!(
            "dataset.toml, line 5: is not valid TOML: found a range of {shown}, expected a lower \
             end below the upper"
        );
        assert_eq!(refusal(&format!("fRS = {ends}")), expected);
    }
    let expected = "dataset.toml: the ranges and descriptions: found one for `mTX`, expected those of the \
                    properties: fRS, cDF";
    assert_eq!(refusal("mTX = [0, 1]"), expected);
    assert!(refusal("frs = [0, 1]").contains("did you mean `fRS`?"));
    assert!(refusal("fRS = [0]").starts_with("dataset.toml, line 5: is not valid TOML"));
}

#[test]
fn repeats_and_locations_average_separately_and_keep_their_spread() {
    let made = Made::long(
        "surface,location,repeat,fRS,cDF\n\
         a,0,0,1,\na,0,1,2,\na,0,2,9,\na,1,0,10,\na,1,1,14,\nb,3,0,5,7\nb,3,1,,8\n",
    );
    let table = made.open().unwrap().tactile().clone();
    let mean = table.averages(&TactileSettings::default(), 3);
    let cell = mean.cell(0, FRS).unwrap();
    assert_eq!((cell.value, cell.readings, cell.locations), (8.0, 5, 2)); // (4 + 12) / 2
    // Squares about 4: 9 + 4 + 25; about 12: 4 + 4; freedom 2 + 1.
    assert!((cell.repeat_std.unwrap() - (46.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    assert!((cell.location_std.unwrap() - 32.0_f64.sqrt()).abs() < 1e-12);
    assert_eq!(mean.cell(0, CDF), None);
    let single = mean.cell(1, FRS).unwrap();
    let spread = (single.repeat_std, single.location_std);
    assert_eq!((single.value, spread), (5.0, (None, None)));
    assert_eq!(mean.value(1, CDF), Some(7.5));
    assert_eq!(mean.column(FRS), [Some(8.0), Some(5.0), None]);

    let repeats = TactileSettings {
        repeats: Average::Median,
        ..TactileSettings::default()
    };
    assert_eq!(table.averages(&repeats, 3).value(0, FRS), Some(7.0)); // (2 + 12) / 2
    let both = TactileSettings {
        locations: Average::Median,
        ..repeats
    };
    assert_eq!(table.averages(&both, 3).value(0, FRS), Some(7.0));
}

#[test]
fn averages_of_values_far_from_zero_keep_their_digits() {
    let touch = |i: u32| (0, i, Some(1e8 + f64::from(i % 2) * 1e-6));
    let table = table(&(0..1000).map(touch).collect::<Vec<_>>());
    let averages = table.averages(&TactileSettings::default(), 1);
    let cell = averages.cell(0, FRS).unwrap();
    // Halves of 1e-6, to the spacing of doubles at 1e8.
    let (mean, std) = (cell.value, cell.repeat_std.unwrap());
    assert!((mean - (1e8 + 5e-7)).abs() <= 1.5e-8, "{mean}");
    // The stored values are multiples of 1.49e-8, so the spread is that far from 5e-7 at most.
    assert!((std - 5e-7).abs() <= 1.5e-8, "{std}");
}

/// A touch: location, repeat, value.
fn touches() -> impl Strategy<Value = Vec<(u32, u32, Option<f64>)>> {
    let touch = (0_u32..4, prop::option::weighted(0.9, -50.0..150.0_f64));
    prop::collection::vec(touch, 1..40).prop_map(|touches| {
        let numbered = (0..).zip(touches);
        let touches = numbered.map(|(at, (location, value))| (location, at, value));
        touches.collect()
    })
}

fn table(touches: &[(u32, u32, Option<f64>)]) -> TactileTable {
    let readings = touches.iter().map(|&(location, repeat, value)| Reading {
        surface: 0,
        location,
        repeat,
        values: vec![value],
    });
    TactileTable {
        properties: vec![property(FRS)],
        readings: readings.collect(),
    }
}

/// The average spelt out from its definition.
fn brute_force(touches: &[(u32, u32, Option<f64>)], settings: TactileSettings) -> Option<f64> {
    let average = |how: Average, values: &[f64]| match how {
        Average::Mean => values.iter().sum::<f64>() / values.len() as f64,
        Average::Median => {
            let mut sorted = values.to_vec();
            sorted.sort_by(f64::total_cmp);
            f64::midpoint(sorted[(sorted.len() - 1) / 2], sorted[sorted.len() / 2])
        }
    };
    let mut of_locations = Vec::new();
    for location in 0..4 {
        let here = touches.iter().filter(|touch| touch.0 == location);
        let values: Vec<f64> = here.filter_map(|touch| touch.2).collect();
        if !values.is_empty() {
            of_locations.push(average(settings.repeats, &values));
        }
    }
    (!of_locations.is_empty()).then(|| average(settings.locations, &of_locations))
}

proptest! {
    #[test]
    fn averages_are_their_definition_in_any_order(
        touches in touches(),
        shuffled in any::<prop::sample::Index>(),
        medians in any::<[bool; 2]>(),
    ) {
        let average = |median| if median { Average::Median } else { Average::Mean };
        let settings = TactileSettings {
            repeats: average(medians[0]),
            locations: average(medians[1]),
            ..TactileSettings::default()
        };
        let averages = table(&touches).averages(&settings, 1);
        match (averages.value(0, FRS), brute_force(&touches, settings)) {
            (Some(found), Some(expected)) => prop_assert!((found - expected).abs() < 1e-10),
            (found, expected) => prop_assert_eq!(found, expected),
        }
        let mut other = touches.clone();
        other.rotate_left(shuffled.index(touches.len()));
        other.reverse();
        prop_assert_eq!(table(&other).averages(&settings, 1), averages);
    }

    #[test]
    fn spread_ignores_a_shift_and_follows_a_scale(touches in touches(), shift in -9.0..9.0_f64) {
        let of = |change: &dyn Fn(f64) -> f64| {
            let changed: Vec<_> =
                touches.iter().map(|&(l, r, value)| (l, r, value.map(change))).collect();
            let averages = table(&changed).averages(&TactileSettings::default(), 1);
            averages.cell(0, FRS).map(|cell| (cell.value, cell.repeat_std, cell.location_std))
        };
        let (plain, shifted, scaled) = (of(&|v| v), of(&|v| v + shift), of(&|v| v * 2.0));
        if let (Some(plain), Some(shifted), Some(scaled)) = (plain, shifted, scaled) {
            let close = |a: Option<f64>, b: Option<f64>| match (a, b) {
                (Some(a), Some(b)) => (a - b).abs() < 1e-10,
                (a, b) => a == b,
            };
            prop_assert!((shifted.0 - plain.0 - shift).abs() < 1e-10);
            prop_assert!(close(shifted.1, plain.1) && close(shifted.2, plain.2));
            // Doubling is exact.
            prop_assert_eq!(scaled.1, plain.1.map(|std| std * 2.0));
            prop_assert_eq!(scaled.2, plain.2.map(|std| std * 2.0));
        }
    }
}
