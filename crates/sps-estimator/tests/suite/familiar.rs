//! What photographs are held against where the encoder learned from surfaces.

use std::fs;

use crate::support::{self, Tables, about, photograph, recipe, refused, ridge};
use safetensors::SafeTensors;
use sps_estimator::{Estimator, Fitted, Session, Sight};

/// 20 of 50 surfaces calibrate; the encoder learned from the others.
#[test]
fn what_the_encoder_saw_is_not_held_against() {
    let tables = Tables::new(50, 2, 1);
    let recipe = recipe(ridge(), &[1]);
    let part = tables.part(&recipe);
    let fit = |saw: &[usize]| tables.fit_beside(&recipe, saw);
    let kept = |fitted: Fitted| {
        let folder = tempfile::tempdir().unwrap();
        let estimator = Estimator::new(support::embedder(), fitted, about(&[1])).unwrap();
        estimator.save(folder.path()).unwrap();
        let bytes = fs::read(folder.path().join("familiar.safetensors")).unwrap();
        let units = SafeTensors::deserialize(&bytes).unwrap();
        let units = units.tensor("units").unwrap().data().to_vec();
        let values = units.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b));
        values.collect::<Vec<f32>>()
    };
    let of_unit_length = |surfaces: &[usize]| {
        let unit = |&at: &usize| {
            let mut row = tables.embeddings.get(at, 1).unwrap();
            let mut units = Vec::new();
            for &width in tables.embeddings.blocks() {
                let (block, rest) = row.split_at(width);
                let squares = block.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>();
                let unit = |&x: &f32| (f64::from(x) / squares.sqrt()) as f32;
                units.extend(block.iter().map(unit));
                row = rest;
            }
            units
        };
        surfaces.iter().flat_map(unit).collect::<Vec<f32>>()
    };
    let trained = fit(&part.train).unwrap();
    assert_eq!(trained.no_familiar(), None);
    assert_eq!(kept(trained), of_unit_length(&part.validation));
    assert_eq!(kept(fit(&[]).unwrap()), of_unit_length(&tables.all()));

    let expected = "surfaces that the encoder saw: found some of units that calibrate";
    refused(fit(&part.validation[..1]), expected);
}

#[test]
fn a_model_that_does_not_know_what_is_familiar_says_why() {
    let tables = Tables::new(40, 1, 1);
    let recipe = recipe(ridge(), &[0]);
    let fitted = tables.fit_beside(&recipe, &tables.part(&recipe).train);
    let estimator = Estimator::new(support::embedder(), fitted.unwrap(), about(&[0])).unwrap();
    let folder = tempfile::tempdir().unwrap();
    estimator.save(folder.path()).unwrap();
    assert!(!folder.path().join("familiar.safetensors").exists());
    let again = Estimator::load(folder.path()).unwrap();
    for model in [estimator, again] {
        let reason = "the encoder learned from the surfaces fitted to, and found 16 surfaces that it has not \
                      seen, expected at least 19 for a p-value of 0.05";
        assert_eq!(model.fitted().no_familiar(), Some(reason));
        let one = [photograph(70, 0)];
        assert_eq!(model.predict(&one).unwrap().familiar, None);
        let map = model.map(&one[0], 16, Sight::Within).unwrap();
        assert_eq!(map.predictions.familiar, None);
        let looked = Session::new(&model, 1.0).unwrap().look(&one[0]).unwrap();
        assert_eq!(looked.answer.familiar, None);
    }
}
