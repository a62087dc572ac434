//! Streams of real photographs, where they are there: of kinds that a model was fitted on, and of one that
//! was left out.

use std::collections::BTreeSet;

use crate::support::{Photographs, about, calibration, examples, kernel};
use sps_dataset::{Source, Unit, Units};
use sps_estimator::{Estimator, Recipe, Watch, Widths};
use sps_models::encoders::{Depths, Encoder, EncoderKind};

struct Streams(Photographs);

impl Streams {
    fn of(name: &str, property: &str) -> Option<Self> {
        let encoder = Encoder::built_in(EncoderKind::EfficientNetLiteBody).unwrap();
        let encoder = encoder.with_depths(&Depths::All).unwrap();
        Photographs::of(name, property, encoder).map(Self)
    }

    fn units(&self) -> Units {
        Units::by(self.0.dataset.surfaces(), Unit::Surface)
    }

    fn all(&self) -> Vec<usize> {
        (0..self.0.dataset.surfaces().len()).collect()
    }

    /// The photograph of the stream at which there is an alarm, of a model fitted on others.
    fn alarm(&self, fitted_on: &[usize], stream: &[usize], number: u64) -> Option<u64> {
        let (properties, calibration) = (self.0.readings.properties(), calibration(0.25, 0.9, 0));
        let recipe = Recipe {
            widths: Widths::Constant,
            ..Recipe::new(kernel(), properties, &[0], calibration)
        };
        let units = self.units();
        let examples = examples(&self.0.embeddings, &self.0.readings, &units);
        let fitted = recipe.fit(&examples, fitted_on, number).unwrap();
        let model = Estimator::new(self.0.embedder.clone(), fitted, about(&[0])).unwrap();
        let mut watch = Watch::new(&model).unwrap();
        let row = |surface: &usize| self.0.embeddings.get(*surface, 0).unwrap();
        // By name, one kind follows the other.
        let scores = stream.iter().map(|at| watch.score(row(at)).unwrap());
        watch.see_in_any_order(scores.collect());
        assert_eq!(watch.seen(), stream.len() as u64);
        watch.alarm()
    }

    /// For each kind with at least so many photographs, how many of them it takes for an alarm, where the
    /// model was fitted on none of them.
    fn left_out(&self, least: usize) -> Vec<Option<u64>> {
        let surfaces = self.0.dataset.surfaces();
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
    let Some(rated) = Streams::of("material-ratings", "hardness") else {
        return;
    };
    let drawn = (0..DRAWS).filter(|&draw| {
        let units = rated.units();
        let split = units.keep_aside(&rated.all(), 0.3, 0, "stream", draw);
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
    let Some(photographs) = Streams::of("friction-photos", "fRS") else {
        return;
    };
    let alarms = photographs.left_out(20);
    assert_eq!(alarms.len(), 8);
    let mut all = alarms.iter();
    let early = all.all(|alarm| alarm.is_some_and(|at| at < 25));
    assert!(early, "{alarms:?}");
}
