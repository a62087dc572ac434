//! The simulator as a source: the same surfaces and frames whatever else is asked for.

use std::collections::BTreeMap;

use rayon::prelude::*;
use sps_dataset::{Source, SourceError, toccare};
use sps_simulate::{SimulateError, Simulator, SimulatorSpec};

/// So many small surfaces in three views, with what is changed.
fn simulator(surfaces: usize, change: impl FnOnce(&mut SimulatorSpec)) -> Simulator {
    let mut spec = SimulatorSpec {
        surfaces,
        seed: 7,
        size: 24,
        views: 3,
        ..SimulatorSpec::default()
    };
    change(&mut spec);
    Simulator::new(spec).unwrap()
}

fn small(surfaces: usize) -> Simulator {
    simulator(surfaces, |_| {})
}

/// Frames of a few surfaces and angles at two sizes. Where this fails, either a change of the
/// simulator was meant, and the printed hash goes here, or something depends on the machine.
#[test]
fn frames_have_the_committed_hash() {
    let mut hasher = blake3::Hasher::new();
    for (size, surfaces) in [(32, 24), (72, 6)] {
        let simulator = simulator(surfaces, |spec| spec.size = size);
        for surface in 0..surfaces {
            for view in 0..3 {
                hasher.update(&simulator.frame_bytes(surface, view).unwrap());
            }
        }
    }
    let expected = "0cff577f0389db0eb2f326eaa5899cd1c1bcd9fb3dec1f3a6bd647ed56a03642";
    assert_eq!(hasher.finalize().to_string(), expected);
}

/// The readings of a few surfaces, to twelve digits.
#[test]
fn readings_have_the_committed_hash() {
    let mut hasher = blake3::Hasher::new();
    for reading in &small(50).tactile().readings {
        for value in &reading.values {
            hasher.update(format!("{:.12e}", value.unwrap()).as_bytes());
        }
    }
    let expected = "e252d8b861b15e956f27554527d850f3ab466c65157c038c9ce296c4d38682bb";
    assert_eq!(hasher.finalize().to_string(), expected);
}

#[test]
fn a_surface_does_not_depend_on_the_others_or_on_what_was_asked_before() {
    let (few, many) = (small(6), small(450));
    for surface in [5, 0, 3] {
        assert_eq!(few.surfaces()[surface], many.surfaces()[surface]);
        for view in [2, 0, 1] {
            let (a, b) = (few.frame(surface, view), many.frame(surface, view));
            assert_eq!(a.unwrap(), b.unwrap());
        }
        let readings = |s: &Simulator| -> Vec<_> {
            let all = s.tactile().readings.iter();
            all.filter(|r| r.surface == surface).cloned().collect()
        };
        assert_eq!(readings(&few), readings(&many));
    }
}

#[test]
fn a_view_depends_on_its_angle_and_not_on_its_number() {
    let (three, one) = (small(6), simulator(6, |spec| spec.views = 1));
    assert_eq!(three.frame(2, 1).unwrap(), one.frame(2, 0).unwrap());
    assert_eq!(three.frame_key(2, 1).unwrap(), one.frame_key(2, 0).unwrap());
}

#[test]
fn threads_do_not_change_frames() {
    let source = small(12);
    let all: Vec<(usize, usize)> = (0..12).flat_map(|s| (0..3).map(move |v| (v, s))).collect();
    let frames = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let frame = |&(view, surface): &(usize, usize)| source.frame_bytes(surface, view).unwrap();
        let frames = || all.par_iter().map(frame).collect::<Vec<_>>();
        pool.unwrap().install(frames)
    };
    assert_eq!(frames(1), frames(7));
}

#[test]
fn keys_are_distinct_and_frames_are_what_an_eight_bit_file_holds() {
    let source = small(6);
    let other_seed = simulator(6, |spec| spec.seed = 8);
    let other_size = simulator(6, |spec| spec.size = 25);
    let mut keys = std::collections::HashSet::new();
    for simulator in [&source, &other_seed, &other_size] {
        for surface in 0..6 {
            for view in 0..3 {
                assert!(keys.insert(simulator.frame_key(surface, view).unwrap()));
            }
        }
    }
    let frame = source.frame(1, 1).unwrap();
    let bytes = source.frame_bytes(1, 1).unwrap();
    assert_eq!((frame.width, frame.height), (24, 24));
    assert_eq!(frame.data.len(), 24 * 24 * 3);
    for (value, byte) in frame.data.iter().zip(bytes) {
        assert_eq!((value * 255.0).round() as u8, byte);
        assert_eq!(*value, f32::from(byte) / 255.0);
    }
}

#[test]
fn indices_out_of_range_are_errors() {
    let source = small(6);
    let refused = |error: SourceError| error.downcast_ref::<SimulateError>().cloned();
    let surface = Some(SimulateError::Surface { found: 6, count: 6 });
    assert_eq!(refused(source.frame(6, 0).unwrap_err()), surface);
    assert_eq!(refused(source.frame_key(6, 0).unwrap_err()), surface);
    let view = Some(SimulateError::View { found: 3, count: 3 });
    assert_eq!(refused(source.frame(0, 3).unwrap_err()), view);
    assert_eq!(refused(source.linear_frame(0, 3).unwrap_err()), view);
}

#[test]
fn every_reading_lies_in_the_range_of_its_property() {
    let source = small(200);
    let table = source.tactile();
    for (column, property) in table.properties.iter().enumerate() {
        let [low, high] = source.describe(property).range.unwrap().ends();
        let mut values = table.readings.iter().filter_map(|r| r.values[column]);
        let all = values.all(|value| (low..=high).contains(&value));
        assert!(all, "{property}");
    }
}

/// A brushed metal near the mirror direction of the light: what a display clips is in the file.
#[test]
fn an_exr_file_keeps_highlights_above_white() {
    use sps_dataset::{DecodeSettings, FrameFormat, WriteOptions, read_image, write_dataset};

    let source = simulator(40, |spec| {
        (spec.views, spec.from_deg, spec.to_deg) = (2, 20.0, 28.0);
    });
    let brightest = |surface| {
        let light = source.linear_frame(surface, 1).unwrap().unwrap();
        light.data.iter().copied().fold(0.0, f32::max)
    };
    let darker = |a: &usize, b: &usize| brightest(*a).total_cmp(&brightest(*b));
    let surface = (0..40).max_by(darker).unwrap();
    assert!(brightest(surface) > 1.5, "{}", brightest(surface));

    let folder = tempfile::tempdir().unwrap();
    let options = WriteOptions {
        format: FrameFormat::Exr,
        description: String::new(),
        source: String::new(),
    };
    write_dataset(&source, folder.path(), &options, |_, _| {}).unwrap();
    let name = format!("frames/{}/001.exr", source.surfaces()[surface].id);
    // Two stops down, the sensor's full well of 4 is the display's white.
    let darker = DecodeSettings {
        exposure_stops: -2.0,
        ..DecodeSettings::default()
    };
    let shown = read_image(&folder.path().join(name), &darker).unwrap();
    let light = source.linear_frame(surface, 1).unwrap().unwrap();
    for (shown, light) in shown.frame.data.iter().zip(&light.data) {
        let decoded = if *shown <= 0.040_45 {
            shown / 12.92
        } else {
            ((shown + 0.055) / 1.055).powf(2.4)
        };
        // A half has 11 bits.
        assert!((4.0 * decoded - light).abs() < 1e-3 * light + 1e-5);
    }
}

#[test]
fn the_quartiles_are_the_published_ones() {
    #[derive(serde::Deserialize)]
    struct Published {
        quantiles: BTreeMap<String, [f64; 5]>,
    }
    let text = include_str!("../../../sps-report/src/published.toml");
    let published: Published = toml::from_str(text).unwrap();
    for seed in [1, 2] {
        let source = simulator(2000, |spec| spec.seed = seed);
        let means = surface_means(&source);
        for (i, property) in toccare::properties().into_iter().enumerate() {
            let mut column: Vec<f64> = means.iter().map(|m| m[i]).collect();
            column.sort_by(f64::total_cmp);
            let expected = published.quantiles[property.code()];
            for (p, expected) in [(0.25, expected[1]), (0.5, expected[2]), (0.75, expected[3])] {
                let found = column[(p * 1999.0) as usize];
                let near = (found - expected).abs() <= 1.5;
                assert!(near, "{property} at {p}: {found} against {expected}");
            }
            assert!(column.iter().all(|&v| (0.0..=100.0).contains(&v)));
        }
    }
}

#[test]
fn repeats_and_places_differ_by_a_realistic_amount() {
    let source = small(200);
    let readings = &source.tactile().readings;
    assert_eq!(readings.len(), 200 * 3 * 5);
    let means = surface_means(&source);
    // Of sliding resistance, the spread between touches of one place is a few percent, and the
    // spread of surfaces several times larger.
    let mut within = 0.0;
    for place in readings.chunks_exact(5) {
        let values: Vec<f64> = place.iter().map(|r| r.values[0].unwrap()).collect();
        let mean = values.iter().sum::<f64>() / 5.0;
        within += values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / 4.0 / 600.0;
    }
    let centre = means.iter().map(|m| m[0]).sum::<f64>() / 200.0;
    let between = means.iter().map(|m| (m[0] - centre).powi(2)).sum::<f64>() / 199.0;
    let ratio = (within / between).sqrt();
    assert!((0.02..0.3).contains(&ratio), "{ratio}");
}

fn surface_means(source: &Simulator) -> Vec<[f64; 15]> {
    let mut sums = vec![[0.0; 15]; source.surfaces().len()];
    let per_surface = (source.spec().locations * source.spec().repeats) as f64;
    for reading in &source.tactile().readings {
        for (sum, value) in sums[reading.surface].iter_mut().zip(&reading.values) {
            *sum += value.unwrap() / per_surface;
        }
    }
    sums
}
