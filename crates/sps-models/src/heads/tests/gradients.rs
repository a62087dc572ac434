//! Losses and gradients against PyTorch's autograd, and that none is missing.

use candle_core::Var;

use super::super::losses::{Batch, Losses};
use super::super::network::{Dims, Network, Spec};
use super::*;
use crate::stacked::{Parameter, tests::gradient};

const TRIALS: usize = 3;
const ROWS: usize = 5;
const WIDTH: usize = 7;

/// The batch of `make_heads_golden.py`.
fn batch() -> Batch {
    let weights = |counts: &dyn Fn(usize, usize) -> bool| {
        let mut weights = Vec::new();
        for trial in 0..TRIALS {
            let number = (0..ROWS).filter(|&row| counts(trial, row)).count() as f64;
            let of = |row| f64::from(u8::from(counts(trial, row))) / number;
            weights.extend((0..ROWS).map(of));
        }
        Tensor::from_vec(weights, (TRIALS, ROWS), &Device::Cpu).unwrap()
    };
    let labelled = |trial: usize, row: usize| (trial + 2 * row) % 5 != 1;
    let label = |i: usize| {
        let (trial, row) = (i / ROWS, i % ROWS);
        labelled(trial, row).then_some(((trial + row) % 3) as u32)
    };
    Batch {
        visual: golden::tensor("golden/heads.visual", &[TRIALS, ROWS, 2 * WIDTH]),
        width: WIDTH,
        tactile: golden::tensor("golden/heads.tactile", &[TRIALS, ROWS, 1]),
        weight: weights(&|trial, row| (trial + row) % 4 != 0),
        labels: (0..TRIALS * ROWS).map(label).collect(),
        label_weight: weights(&labelled),
    }
}

#[test]
fn losses_and_gradients_are_pytorchs() {
    let expected = golden::load("heads.safetensors");
    let model = golden::cross_modal();
    let dims = Dims {
        slots: 2,
        width: WIDTH,
        classes: 3,
    };
    // By the rule of the golden files.
    let mut parameters = Vec::new();
    let mut fill = |spec: &Spec<'_>| {
        let shape = [&[TRIALS], spec.shape].concat();
        let values = golden::tensor(&format!("golden/heads.{}", spec.name), &shape);
        let parameter = Parameter::variable(&Var::from_tensor(&values)?);
        parameters.push((spec.name.to_owned(), parameter.clone()));
        Ok(parameter)
    };
    let config = HeadConfig {
        input: Input::LateFusion { views: 2 },
        model: model.clone(),
        ..HeadConfig::default()
    };
    let network = Network::new(&mut fill, &config, dims).unwrap();
    let losses = Losses::of(&network, &batch()).unwrap();
    let names = [
        "estimation",
        "embedding",
        "generator",
        "discriminator",
        "classification",
    ];
    assert_eq!(losses.terms().count(), names.len());
    for (name, (_, loss)) in names.iter().zip(losses.terms()) {
        let expected = golden::values(&expected[&format!("loss.{name}")]);
        let error = golden::error(&golden::values(loss), &expected);
        assert!(error < 1e-14, "{name}: {error:e}");
    }
    losses.total(&model).unwrap().backward().unwrap();
    assert_eq!(parameters.len(), 17);
    for (name, parameter) in &parameters {
        let expected = golden::values(&expected[&format!("gradient.{name}")]);
        let error = golden::error(&gradient(parameter), &expected);
        assert!(error < 1e-13, "{name}: {error:e}");
    }
}

#[test]
fn every_parameter_of_every_model_receives_a_gradient_and_moves() {
    let set = Set::new(30, 3, 8, 1);
    let mut configs = vec![full(), full(), full(), full(), full()];
    configs[0].model = Model::Regression {};
    cross_modal(&mut configs[1]).adversarial = None;
    cross_modal(&mut configs[2]).classification = None;
    cross_modal(&mut configs[3]).embedding_weight = 0.0;
    configs[4].input = Input::LateFusion { views: 3 };
    for mut config in configs {
        config.epochs = 1;
        let mut plan = set.plan(1);
        if let Input::LateFusion { .. } = config.input {
            plan.trials[0].views = Views::Fixed(vec![0, 1, 2]);
        }
        let once = set.train(&config, &plan);
        config.epochs = 2;
        let twice = set.train(&config, &plan);
        for (name, before) in once.heads()[0].parameters.iter() {
            let before = golden::values(before);
            let after = golden::values(twice.heads()[0].parameters.get(name).unwrap());
            // A unit of a rectifier may be silent; a whole parameter may not.
            assert_ne!(before, after, "{name} of {config:?}");
        }
    }
}

#[test]
fn a_model_without_the_embedding_constraint_has_no_tactile_encoder() {
    let set = Set::new(20, 1, 4, 1);
    let mut config = full();
    cross_modal(&mut config).embedding_weight = 0.0;
    let trained = set.train(&config, &set.plan(1));
    let mut parameters = trained.heads()[0].parameters.iter();
    assert!(!parameters.any(|(name, _)| name.starts_with("tactile")));
}
