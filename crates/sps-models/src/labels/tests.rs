use ndarray::{Array2, array};

use super::clusters::{columns, stream_for_linfa};
use super::*;
use crate::error::Error;
use crate::golden;
use crate::pca::Pca;

fn readings(rows: &[Vec<Option<f64>>]) -> Readings {
    let names = (0..rows[0].len()).map(|p| format!("p{p}")).collect();
    Readings::new(names, rows).unwrap()
}

fn embeddings(rows: usize, width: usize, value: impl Fn(usize, usize) -> f32) -> Embeddings {
    let values: Vec<f32> = (0..rows * width)
        .map(|i| value(i / width, i % width))
        .collect();
    let tensor = candle_core::Tensor::from_vec(values, (rows, width), &candle_core::Device::Cpu);
    Embeddings::new(&tensor.unwrap()).unwrap()
}

/// Three groups of surfaces far apart, in sight and in touch.
fn planted(surfaces: usize) -> (Readings, Embeddings) {
    let noise = golden::uniform("labels.noise", surfaces * 10);
    let group = |surface: usize| (surface % 3) as f64;
    let touch: Vec<_> = (0..surfaces)
        .map(|s| {
            (0..4)
                .map(|p| Some(10.0 * group(s) + noise[s * 10 + p]))
                .collect()
        })
        .collect();
    let sight = embeddings(surfaces, 6, |s, f| {
        (5.0 * group(s) + noise[s * 10 + 4 + f]) as f32
    });
    (readings(&touch), sight)
}

fn tables<'a>(readings: &'a Readings, visual: &'a Embeddings) -> LabelTables<'a> {
    LabelTables {
        readings,
        visual,
        materials: None,
    }
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
fn principal_components_are_scikit_learns() {
    let values = golden::uniform("golden/pca", 60 * 40);
    let mut rows = Array2::from_shape_vec((60, 40), values).unwrap();
    for (column, mut values) in rows.columns_mut().into_iter().enumerate() {
        values *= 1.3_f64.powi(-(column as i32));
    }
    let pca = Pca::fit(rows.view(), 8).unwrap();
    let expected = golden::load("pca.safetensors");
    let variance = golden::values(&expected["explained_variance"]);
    assert!(golden::error(pca.explained_variance(), &variance) < 1e-13);
    let scores = pca.transform(rows.view()).mapv(f64::abs);
    let scores = scores.iter().copied().collect::<Vec<_>>();
    assert!(golden::error(&scores, &golden::values(&expected["abs_scores"])) < 1e-12);
    for component in pca.components().rows() {
        let largest = component
            .iter()
            .fold(0.0_f64, |a, &b| if b.abs() > a.abs() { b } else { a });
        assert!(largest > 0.0);
        assert!((component.dot(&component) - 1.0).abs() < 1e-13);
    }
}

#[test]
fn clusters_find_groups_that_are_far_apart() {
    let (readings, visual) = planted(30);
    let tables = tables(&readings, &visual);
    let training: Vec<usize> = (3..30).collect();
    for source in sources(3) {
        let labels = label(&source, &tables, &training, 1, 0).unwrap();
        assert_eq!(labels.classes(), 3);
        for (a, &one) in training.iter().enumerate() {
            for (b, &other) in training.iter().enumerate() {
                let same = labels.of()[a] == labels.of()[b];
                assert_eq!(same, one % 3 == other % 3, "surfaces {one} and {other}");
            }
        }
    }
}

#[test]
fn labels_repeat_on_any_number_of_threads_and_ignore_surfaces_kept_out() {
    let (readings, visual) = planted(40);
    let other = embeddings(
        40,
        6,
        |s, f| if s < 20 { visual.view(s, 0)[f] } else { 1e3 },
    );
    let training: Vec<usize> = (0..20).collect();
    for source in sources(7) {
        let with = |threads, visual| {
            let tables = tables(&readings, visual);
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| label(&source, &tables, &training, 5, 2).unwrap())
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
    let mut tables = tables(&readings, &visual);
    tables.materials = Some(&materials);
    let labels = label(&LabelSource::Material {}, &tables, &[0, 2, 4], 1, 0).unwrap();
    assert_eq!(labels.classes(), 3);
    assert_eq!(labels.of(), [Some(2), Some(2), Some(0)]);
    tables.materials = None;
    let error = label(&LabelSource::Material {}, &tables, &[0], 1, 0).unwrap_err();
    assert!(matches!(error, Error::Label(LabelError::NoMaterials)));
}

#[test]
fn standardising_is_what_makes_sight_count() {
    // Touch: two wide groups 60 apart. Sight: two other groups.
    let noise = golden::uniform("labels.noise", 400);
    let touch: Vec<_> = (0..40)
        .map(|s| vec![Some(if s % 2 == 0 { 20.0 } else { 80.0 } + 8.0 * noise[s])])
        .collect();
    let readings = readings(&touch);
    let visual = embeddings(40, 3, |s, f| {
        (if s < 20 { -1.0 } else { 1.0 } + 0.05 * noise[40 + s * 3 + f]) as f32
    });
    let tables = tables(&readings, &visual);
    let training: Vec<usize> = (0..40).collect();
    let groups = |standardise_tactile| {
        let source = LabelSource::VisuoTactileCluster {
            clusters: 4,
            components: 1,
            standardise_tactile,
        };
        let labels = label(&source, &tables, &training, 1, 0).unwrap();
        let of = |s: usize| labels.of()[s];
        // Whether surfaces that feel alike and look different are told apart.
        of(0) != of(20) && of(1) != of(21)
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
    let tables = tables(&readings, &visual);
    let [touch, both] = sources(2);
    let labels = label(&touch, &tables, &[0, 1, 2, 3], 1, 0).unwrap();
    assert_eq!(labels.of()[2], None);
    assert_eq!(labels.of()[1], labels.of()[3]);
    assert_ne!(labels.of()[0], labels.of()[1]);
    let labels = label(&both, &tables, &[0, 1, 2, 3], 1, 0).unwrap();
    assert!(labels.of().iter().all(Option::is_some));
    let error = label(&touch, &tables, &[2], 1, 0).unwrap_err();
    assert!(matches!(error, Error::Label(LabelError::NotMeasured)));
}

#[test]
fn bad_input_is_named() {
    let (readings, visual) = planted(5);
    let tables = tables(&readings, &visual);
    let failure = |source: &LabelSource, training: &[usize]| {
        label(source, &tables, training, 1, 0)
            .unwrap_err()
            .to_string()
    };
    let [touch, _] = sources(0);
    assert!(failure(&touch, &[0]).contains("clusters is 0"));
    let [touch, both] = sources(2);
    assert!(failure(&touch, &[]).contains("no training surface"));
    assert!(failure(&both, &[7]).contains("index 7, expected below 5"));
    let rows = array![[0.0, f64::NAN]];
    let error = Pca::fit(rows.view(), 1).unwrap_err();
    assert!(matches!(error, LabelError::NotFinite { row: 0, .. }));
}

#[test]
fn a_misspelt_key_of_a_label_source_is_refused() {
    let parse = |text: &str| toml::from_str::<LabelSource>(text);
    assert_eq!(
        parse("source = \"visuo-tactile-cluster\"").unwrap(),
        LabelSource::visuo_tactile_cluster()
    );
    assert_eq!(
        parse("source = \"tactile-cluster\"").unwrap(),
        LabelSource::tactile_cluster()
    );
    assert!(parse("source = \"material\"").is_ok());
    assert!(parse("source = \"material\"\nclusters = 3").is_err());
    assert!(parse("source = \"tactile-cluster\"\nclusterz = 3").is_err());
    assert!(parse("source = \"tactile-cluster\"\ncomponents = 3").is_err());
}

mod hard_cases {
    use super::*;

    /// Less the mean over the spread, rounding or not.
    fn naively_standardised(values: &[f64]) -> Vec<f64> {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let spread = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        values.iter().map(|v| (v - mean) / spread).collect()
    }

    fn within(case: &str, error: f64, bound: f64, naive: f64) {
        println!("{case}: error {error:.1e}, bound {bound:.0e}, naive form {naive:.1e}");
        assert!(error <= bound, "{case}");
        assert!(naive.is_nan() || naive > bound, "{case}: the naive form");
    }

    fn table(rows: &[[f64; 3]]) -> Array2<f64> {
        Array2::from_shape_fn((rows.len(), 3), |(row, column)| rows[row][column])
    }

    /// Two points span one direction: its variance is half the squared distance.
    #[test]
    fn fewer_samples_than_components() {
        let rows = table(&[[1.0, 2.0, 3.0], [4.0, 6.0, 3.0]]);
        let pca = Pca::fit(rows.view(), 3).unwrap();
        assert!(golden::error(pca.explained_variance(), &[12.5]) < 1e-15);
        let component = pca.components().row(0).to_vec();
        assert!(golden::error(&component, &[0.6, 0.8, 0.0]) < 1e-15);
        let scores = pca.transform(rows.view());
        assert_eq!(scores.ncols(), 1);
        let error = golden::error(&scores.column(0).to_vec(), &[-2.5, 2.5]);
        // A second direction, across the first, holds rounding: standardised it is noise of one.
        let across = rows.map_axis(ndarray::Axis(1), |row| 0.08 * row[0] - 0.06 * row[1]);
        let naive = naively_standardised(across.as_slice().unwrap())[0].abs();
        within("two samples, three components", error, 1e-15, naive);
        let one = Pca::fit(rows.slice(ndarray::s![..1, ..]), 3).unwrap();
        assert!(one.explained_variance().is_empty());
    }

    /// Equal rows have no direction. The mean of equal values is off by rounding, and a component
    /// made of that, standardised, would be noise of variance one.
    #[test]
    fn duplicate_rows() {
        let rows = Array2::from_shape_fn((7, 3), |(_, column)| [0.1, 1e3, -7.7][column]);
        let naive = naively_standardised(&rows.column(0).to_vec())[0].abs();
        within("duplicate rows", 0.0, 0.0, naive);
        assert!(
            Pca::fit(rows.view(), 3)
                .unwrap()
                .explained_variance()
                .is_empty()
        );
        let rows =
            Array2::from_shape_fn((14, 3), |(row, c)| [0.1, 1e3, -7.7][c] + (row % 2) as f64);
        assert_eq!(
            Pca::fit(rows.view(), 3).unwrap().explained_variance().len(),
            1
        );
    }

    /// A constant feature stays zero when it is standardised. By the plain quotient it becomes
    /// the rounding of its mean over itself.
    #[test]
    fn features_of_zero_variance() {
        let constant = Array2::from_elem((10, 1), 0.1);
        assert!(columns(constant.clone()).iter().all(|&v| v == 0.0));
        let naive = naively_standardised(&constant.column(0).to_vec())[0].abs();
        within("zero variance", 0.0, 0.0, naive);
        // A real spread at a large offset is kept.
        let offset = Array2::from_shape_fn((4, 1), |(row, _)| 1e8 + [0.0, 1.0][row % 2]);
        let standard = columns(offset);
        assert!(golden::error(&standard.column(0).to_vec(), &[-1.0, 1.0, -1.0, 1.0]) < 1e-15);
    }

    /// Fifteen clusters of three distinct surfaces are three.
    #[test]
    fn more_clusters_than_distinct_points() {
        let rows: Vec<_> = (0..9)
            .map(|s| vec![Some((s % 3) as f64), Some(-0.0)])
            .collect();
        let readings = readings(&rows);
        let visual = embeddings(9, 2, |s, _| (s % 3) as f32);
        let tables = tables(&readings, &visual);
        for source in sources(15) {
            let training: Vec<usize> = (0..9).collect();
            let labels = label(&source, &tables, &training, 3, 0).unwrap();
            assert_eq!(labels.classes(), 3);
            let naive = 15.min(training.len());
            assert_ne!(
                naive, 3,
                "the naive form has classes that nothing belongs to"
            );
            for s in 0..9 {
                assert_eq!(labels.of()[s], labels.of()[s % 3]);
            }
            assert_ne!(labels.of()[0], labels.of()[1]);
            assert_ne!(labels.of()[1], labels.of()[2]);
            assert_ne!(labels.of()[0], labels.of()[2]);
        }
    }

    /// The same table upside down has the same components, sign and all.
    #[test]
    fn sign_and_order_of_components() {
        let values = golden::uniform("labels.signs", 20 * 5);
        let rows = Array2::from_shape_vec((20, 5), values).unwrap();
        let mirrored = rows.slice(ndarray::s![..;-1, ..]).to_owned();
        let (one, other) = (
            Pca::fit(rows.view(), 5).unwrap(),
            Pca::fit(mirrored.view(), 5).unwrap(),
        );
        let apart = |one: &Array2<f64>, other: &Array2<f64>| {
            let differences = (one - other).mapv(f64::abs);
            differences.iter().copied().fold(0.0, f64::max)
        };
        let from_below = apart(&one.components().to_owned(), &other.components().to_owned());
        let variance = one.explained_variance();
        assert!(variance.windows(2).all(|pair| pair[0] >= pair[1]));
        // Negating the table negates the scores, and leaves the components.
        let minus = -&rows;
        let negated = Pca::fit(minus.view(), 5).unwrap();
        let of_minus = apart(
            &one.components().to_owned(),
            &negated.components().to_owned(),
        );
        // By the largest score in place of the largest loading, as scikit-learn did before 1.5.
        let by_score = |pca: &Pca, rows: &Array2<f64>| {
            let scores = pca.transform(rows.view());
            let mut components = pca.components().to_owned();
            for (mut component, scores) in components.rows_mut().into_iter().zip(scores.columns()) {
                let larger = |a: f64, &b: &f64| if b.abs() > a.abs() { b } else { a };
                component *= scores.iter().fold(0.0, larger).signum();
            }
            components
        };
        let naive = apart(&by_score(&one, &rows), &by_score(&negated, &minus));
        within("sign of components", from_below.max(of_minus), 1e-12, naive);
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
