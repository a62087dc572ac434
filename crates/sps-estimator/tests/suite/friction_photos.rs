//! Photographs of eight materials with a measured friction coefficient each, where they are there.

use std::collections::BTreeMap;

use crate::support::{Photographs, calibration, examples, ridge, shared};
use sps_dataset::{Source, Unit, Units};
use sps_estimator::Recipe;
use sps_models::encoders::{Encoder, EncoderKind};

/// The share of pairs that a score puts in order, ties counted half.
fn auroc(known: &[f64], new: &[f64]) -> f64 {
    let won = known.iter().flat_map(|known| {
        new.iter().map(move |new| match known.total_cmp(new) {
            std::cmp::Ordering::Greater => 1.0,
            std::cmp::Ordering::Equal => 0.5,
            std::cmp::Ordering::Less => 0.0,
        })
    });
    won.sum::<f64>() / (known.len() * new.len()) as f64
}

/// A model of seven materials, and of four fifths of their photographs, knows the rest of them from
/// those of the eighth; and has no interval, as seven groups cannot promise 90 %.
#[test]
fn a_material_that_was_left_out_is_unfamiliar() {
    let Some(weights) = shared("weights/squeezenet1_0.f16.safetensors") else {
        return;
    };
    let encoder = Encoder::load(EncoderKind::SqueezeNet1_0, weights).unwrap();
    let Some(photographs) = Photographs::of("friction-photos", "fRS", encoder) else {
        return;
    };
    let Photographs {
        dataset,
        embeddings,
        readings,
        ..
    } = &photographs;
    let surfaces = dataset.surfaces();
    let units = Units::of(surfaces);
    let recipe = Recipe::new(ridge(), ["fRS"], &[0], calibration(0.25, 0.9, 0));
    let examples = examples(embeddings, readings, &units);
    let single = Units::by(surfaces, Unit::Surface);
    let mut of_material = BTreeMap::new();
    let (mut all_known, mut all_new) = (Vec::new(), Vec::new());
    let all: Vec<usize> = (0..surfaces.len()).collect();
    for (number, split) in (0..).zip(units.each_aside(&all).unwrap()) {
        let aside = single.keep_aside(&split.train, 0.2, 3, "set aside", number);
        let aside = aside.unwrap();
        let fitted = recipe.fit(&examples, &aside.train, number).unwrap();
        let p_values = |of: &[usize]| {
            let predictions = fitted.predict(&embeddings.select(of, &[0]).unwrap());
            let predictions = predictions.unwrap();
            let reason = predictions.properties[0].intervals.clone().unwrap_err();
            let needs = "a level of 0.9 needs at least 9";
            assert!(reason.contains(needs), "{reason}");
            predictions.familiar.unwrap()
        };
        let (known, new) = (p_values(&aside.validation), p_values(&split.validation));
        let material = surfaces[split.validation[0]].material.as_str();
        of_material.insert(material, auroc(&known, &new));
        all_known.extend(known);
        all_new.extend(new);
    }
    let overall = auroc(&all_known, &all_new);
    let flagged = |p_values: &[f64]| {
        p_values.iter().filter(|p| **p <= 0.05).count() as f64 / p_values.len() as f64
    };
    println!("AUROC {overall:.3}; {of_material:.3?}");
    let (known, new) = (flagged(&all_known), flagged(&all_new));
    println!("p <= 0.05: known {known:.3}, new {new:.3}");
    assert!(overall >= 0.95, "{overall}");
    let each = of_material.values().all(|auroc| *auroc >= 0.85);
    assert!(each, "{of_material:?}");
    // 5 % are promised on average; three standard errors of as many photographs.
    let error = 3.0 * (0.05 * 0.95 / all_known.len() as f64).sqrt();
    assert!(known <= 0.05 + error);
}
