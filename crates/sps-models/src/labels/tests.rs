use sps_regress::{Embeddings, Readings};

use super::clusters::stream_for_linfa;
use super::*;
use crate::golden;

fn readings(rows: &[Vec<Option<f64>>]) -> Readings {
    let names = (0..rows[0].len()).map(|p| format!("p{p}")).collect();
    Readings::new(names, rows).unwrap()
}

fn embeddings(rows: usize, width: usize, value: impl Fn(usize, usize) -> f32) -> Embeddings {
    let values = (0..rows * width).map(|i| value(i / width, i % width));
    Embeddings::new(values.collect(), [rows, 1, width]).unwrap()
}

/// Three groups of surfaces far apart, in sight and in touch.
fn planted(surfaces: usize) -> (Readings, Embeddings) {
    let noise = golden::uniform("labels.noise", surfaces * 10);
    let group = |surface: usize| (surface % 3) as f64;
    let touched = |s: usize, p: usize| Some(10.0 * group(s) + noise[s * 10 + p]);
    let row = |s| (0..4).map(|p| touched(s, p)).collect();
    let touch: Vec<_> = (0..surfaces).map(row).collect();
    let sight = embeddings(surfaces, 6, |s, f| {
        (5.0 * group(s) + noise[s * 10 + 4 + f]) as f32
    });
    (readings(&touch), sight)
}

fn sources(clusters: usize) -> [LabelSource; 2] {
    [
        LabelSource::TactileCluster {
            clusters,
            standardise_tactile: true,
        },
        LabelSource::VisuoTactileCluster {
            clusters,
            components: 3,
            standardise_tactile: true,
        },
    ]
}

#[test]
fn clusters_find_groups_that_are_far_apart() {
    let (readings, visual) = planted(30);
    let tables = TrainingData::new(&visual, &readings);
    let training: Vec<usize> = (3..30).collect();
    for source in sources(3) {
        let labels = label(&source, &tables, &training, 1, 0).unwrap();
        assert_eq!(labels.classes, 3);
        for (a, &one) in training.iter().enumerate() {
            for (b, &other) in training.iter().enumerate() {
                let same = labels.of[a] == labels.of[b];
                assert_eq!(same, one % 3 == other % 3, "surfaces {one} and {other}");
            }
        }
    }
}

#[test]
fn labels_repeat_on_any_number_of_threads_and_ignore_surfaces_kept_out() {
    let (readings, visual) = planted(40);
    let other = embeddings(40, 6, |s, f| {
        if s < 20 {
            visual.get(s, 0).unwrap()[f]
        } else {
            1e3
        }
    });
    let training: Vec<usize> = (0..20).collect();
    for source in sources(7) {
        let with = |threads, visual| {
            let tables = TrainingData::new(visual, &readings);
            let labels = || label(&source, &tables, &training, 5, 2).unwrap();
            golden::on_threads(threads, labels)
        };
        let one = with(1, &visual);
        assert_eq!(one, with(2, &visual));
        assert_eq!(one, with(5, &visual));
        assert_eq!(one, with(2, &other));
    }
}

#[test]
fn a_material_is_a_class_with_or_without_a_training_surface() {
    let (readings, visual) = planted(5);
    let materials = ["wood", "silk", "wood", "stone", "silk"].map(String::from);
    let mut tables = TrainingData::new(&visual, &readings);
    tables.materials = Some(&materials);
    let labels = label(&LabelSource::Material {}, &tables, &[0, 2, 4], 1, 0).unwrap();
    assert_eq!(labels.classes, 3);
    assert_eq!(labels.of, [Some(2), Some(2), Some(0)]);
    tables.materials = None;
    let error = label(&LabelSource::Material {}, &tables, &[0], 1, 0).unwrap_err();
    let expected = "materials: found none";
    assert!(error.to_string().starts_with(expected), "{error}");
}

#[test]
fn standardising_is_what_makes_sight_count() {
    // Touch: two wide groups 60 apart. Sight: two other groups.
    let noise = golden::uniform("labels.noise", 400);
    let middle = |s: usize| if s.is_multiple_of(2) { 20.0 } else { 80.0 };
    let row = |s: usize| vec![Some(middle(s) + 8.0 * noise[s])];
    let touch: Vec<_> = (0..40).map(row).collect();
    let readings = readings(&touch);
    let visual = embeddings(40, 3, |s, f| {
        (if s < 20 { -1.0 } else { 1.0 } + 0.05 * noise[40 + s * 3 + f]) as f32
    });
    let tables = TrainingData::new(&visual, &readings);
    let training: Vec<usize> = (0..40).collect();
    let groups = |standardise_tactile| {
        let source = LabelSource::VisuoTactileCluster {
            clusters: 4,
            components: 1,
            standardise_tactile,
        };
        let labels = label(&source, &tables, &training, 1, 0).unwrap();
        let of = &labels.of;
        // Whether surfaces that feel alike and look different are told apart.
        of[0] != of[20] && of[1] != of[21]
    };
    assert!(groups(true));
    assert!(!groups(false));
}

#[test]
fn a_missing_reading_counts_as_the_mean_and_a_surface_without_any_has_no_tactile_label() {
    let rows = [
        vec![Some(0.0), Some(0.0)],
        vec![Some(10.0), Some(10.0)],
        vec![None, None],
        vec![Some(10.0), None],
    ];
    let readings = readings(&rows);
    let visual = embeddings(4, 1, |s, _| s as f32);
    let tables = TrainingData::new(&visual, &readings);
    let [touch, both] = sources(2);
    let labels = label(&touch, &tables, &[0, 1, 2, 3], 1, 0).unwrap();
    assert_eq!(labels.of[2], None);
    assert_eq!(labels.of[1], labels.of[3]);
    assert_ne!(labels.of[0], labels.of[1]);
    let labels = label(&both, &tables, &[0, 1, 2, 3], 1, 0).unwrap();
    assert!(labels.of.iter().all(Option::is_some));
    let error = label(&touch, &tables, &[2], 1, 0).unwrap_err();
    let expected = "readings for labels: found none";
    assert!(error.to_string().starts_with(expected), "{error}");
}

#[test]
fn bad_input_is_named() {
    let (readings, visual) = planted(5);
    let tables = TrainingData::new(&visual, &readings);
    let refused = |source: &LabelSource, training: &[usize], expected: &str| {
        golden::refused(label(source, &tables, training, 1, 0), expected);
    };
    let [touch, _] = sources(0);
    refused(&touch, &[0], "clusters: found 0");
    let [touch, both] = sources(2);
    refused(&touch, &[], "surfaces to label: found none");
    refused(&both, &[7], "index 7, expected below 5");
}

#[test]
fn a_misspelt_key_of_a_label_source_is_refused() {
    let parse = |text: &str| toml::from_str::<LabelSource>(text);
    let both = LabelSource::VisuoTactileCluster {
        clusters: 15,
        components: 15,
        standardise_tactile: true,
    };
    assert_eq!(parse("source = \"visuo-tactile-cluster\"").unwrap(), both);
    let [touch, _] = sources(15);
    assert_eq!(parse("source = \"tactile-cluster\"").unwrap(), touch);
    assert!(parse("source = \"material\"").is_ok());
    assert!(parse("source = \"material\"\nclusters = 3").is_err());
    assert!(parse("source = \"tactile-cluster\"\nclusterz = 3").is_err());
    assert!(parse("source = \"tactile-cluster\"\ncomponents = 3").is_err());
}

mod hard_cases {
    use super::*;

    /// Fifteen clusters of three distinct surfaces are three.
    #[test]
    fn more_clusters_than_distinct_points() {
        let row = |s: usize| vec![Some((s % 3) as f64), Some(-0.0)];
        let rows: Vec<_> = (0..9).map(row).collect();
        let readings = readings(&rows);
        let visual = embeddings(9, 2, |s, _| (s % 3) as f32);
        let tables = TrainingData::new(&visual, &readings);
        for source in sources(15) {
            let training: Vec<usize> = (0..9).collect();
            let labels = label(&source, &tables, &training, 3, 0).unwrap();
            assert_eq!(labels.classes, 3);
            let naive = 15.min(training.len());
            assert_ne!(naive, 3, "the naive form has classes without a member");
            for s in 0..9 {
                assert_eq!(labels.of[s], labels.of[s % 3]);
            }
            assert_ne!(labels.of[0], labels.of[1]);
            assert_ne!(labels.of[1], labels.of[2]);
            assert_ne!(labels.of[0], labels.of[2]);
        }
    }
}

#[test]
fn a_stream_is_the_same_for_both_versions_of_rand() {
    use rand_chacha_03::rand_core::RngCore as _;
    use sps_base::streams::{RngCore as _, named_stream};
    let mut new = named_stream(7, "labels", 3);
    let mut old = stream_for_linfa(7, "labels", 3);
    for _ in 0..100 {
        assert_eq!(new.next_u64(), old.next_u64());
    }
}
