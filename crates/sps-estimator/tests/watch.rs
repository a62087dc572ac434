//! Streams of real photographs, where they are there: of kinds that a model was fitted on, and of one that
//! was left out.

use std::collections::BTreeSet;
use std::path::Path;

use sps_dataset::{DatasetFolder, ReadSettings, Source, TactileSettings, Unit, Units};
use sps_estimator::{
    About, Calibration, Embedder, Estimator, Examples, Network, Recipe, Regression, Wanted, Watch,
    Widths,
};
use sps_metrics::Level;
use sps_models::encoders::{Depths, Encoder, EncoderKind};
use sps_regress::kernel_ridge::{KernelRidge, KernelRidgeConfig};
use sps_regress::{AnyRegressor, Embeddings, Readings, TrainingData};

/// Photographs of surfaces with one value each, and what they look like.
struct Photographs {
    dataset: DatasetFolder,
    embedder: Embedder,
    embeddings: Embeddings,
    readings: Readings,
}

impl Photographs {
    fn of(name: &str, property: &str) -> Option<Self> {
        let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
        let folder = shared.join(name);
        if !folder.exists() {
            println!("SKIPPED: {} is not there", folder.display());
            return None;
        }
        let dataset = DatasetFolder::open(&folder, &ReadSettings::default()).unwrap();
        let encoder = Encoder::built_in(EncoderKind::EfficientNetLiteBody).unwrap();
        let encoder = encoder.with_depths(&Depths::All).unwrap();
        let embedder = Embedder::new(Network::Images(encoder), None).unwrap();
        let count = dataset.surfaces().len();
        let frames = (0..count).map(|surface| dataset.frame(surface, 0).unwrap());
        let values = embedder.embed(&frames.collect::<Vec<_>>()).unwrap();
        let touched = dataset
            .tactile()
            .averages(&TactileSettings::default(), count);
        let rows: Vec<_> = (0..count)
            .map(|at| vec![touched.value(at, property)])
            .collect();
        Some(Self {
            readings: Readings::new(vec![property.to_owned()], &rows).unwrap(),
            embeddings: embedder.table(&values, count, 1).unwrap(),
            embedder,
            dataset,
        })
    }

    fn units(&self) -> Units {
        Units::by(self.dataset.surfaces(), Unit::Surface)
    }

    fn all(&self) -> Vec<usize> {
        (0..self.dataset.surfaces().len()).collect()
    }

    /// The photograph of the stream at which there is an alarm, of a model fitted on others.
    fn alarm(&self, fitted_on: &[usize], stream: &[usize], number: u64) -> Option<u64> {
        let property = self.readings.properties()[0].clone();
        let ridge = KernelRidge::new(KernelRidgeConfig::default()).unwrap();
        let recipe = Recipe {
            regression: Regression::Rows(AnyRegressor::KernelRidge(ridge)),
            wanted: vec![Wanted {
                property,
                views: vec![0],
                range: None,
            }],
            one_by_one: false,
            widths: Widths::Constant,
            calibration: Calibration {
                share: Some(0.25),
                level: Level::P90,
                seed: 0,
            },
        };
        let units = self.units();
        let examples = Examples {
            data: TrainingData::new(&self.embeddings, &self.readings),
            units: &units,
            encoder_saw: &[],
        };
        let fitted = recipe.fit(&examples, fitted_on, number).unwrap();
        let about = About {
            frame_size: [256, 256],
            angles: vec![0.0],
            ..About::default()
        };
        let model = Estimator::new(self.embedder.clone(), fitted, about).unwrap();
        let mut watch = Watch::new(&model).unwrap();
        let row = |surface: &usize| self.embeddings.get(*surface, 0).unwrap();
        // By name, one kind follows the other.
        let scores = stream
            .iter()
            .map(|surface| watch.score(row(surface)).unwrap());
        watch.see_in_any_order(scores.collect());
        assert_eq!(watch.seen(), stream.len() as u64);
        watch.alarm()
    }

    /// For each kind with at least so many photographs, how many of them it takes for an alarm, where the
    /// model was fitted on none of them.
    fn left_out(&self, least: usize) -> Vec<Option<u64>> {
        let surfaces = self.dataset.surfaces();
        let kinds: BTreeSet<&str> = surfaces.iter().map(|one| one.material.as_str()).collect();
        let mut alarms = Vec::new();
        for kind in kinds {
            let is_kind = |at: &usize| surfaces[*at].material == kind;
            let (stream, others): (Vec<usize>, Vec<usize>) =
                self.all().into_iter().partition(is_kind);
            if stream.len() >= least {
                let alarm = self.alarm(&others, &stream, 0);
                println!("{kind}, {} photographs: alarm at {alarm:?}", stream.len());
                alarms.push(alarm);
            }
        }
        alarms
    }
}

#[test]
fn known_kinds_raise_no_alarm_and_one_that_was_left_out_does() {
    const DRAWS: u64 = 40;
    let Some(rated) = Photographs::of("material-ratings", "hardness") else {
        return;
    };
    let drawn = (0..DRAWS).filter(|&draw| {
        let split = rated
            .units()
            .keep_aside(&rated.all(), 0.3, 0, "stream", draw);
        let split = split.unwrap();
        rated.alarm(&split.train, &split.validation, draw).is_some()
    });
    let drawn = drawn.count();
    println!("{drawn} alarms in {DRAWS} streams of known kinds");
    assert!(drawn <= 2, "{drawn}");
    let found = rated.left_out(40);
    assert!(found.iter().flatten().any(|&alarm| alarm < 60), "{found:?}");
}

#[test]
fn a_material_that_was_left_out_raises_one() {
    let Some(photographs) = Photographs::of("friction-photos", "fRS") else {
        return;
    };
    let alarms = photographs.left_out(20);
    assert_eq!(alarms.len(), 8);
    assert!(
        alarms.iter().all(|alarm| alarm.is_some_and(|at| at < 25)),
        "{alarms:?}"
    );
}
