//! Steps whose batch goes through the network in parts.

use super::heads::{Pairs, inputs, through_heads};
use super::*;
use crate::encoders::Depths;
use crate::training::batches::Batch;

fn in_parts(mut config: TrainingConfig, at_once: Option<usize>) -> TrainingConfig {
    config.micro_batch_size = at_once;
    config
}

/// The gradients and losses of one step of eleven surfaces, whole and in parts of 2 and 3: of a network without batch
/// norm, which would see the parts one by one.
fn differs(source: &dyn ImageSource, targets: &Targets, config: &TrainingConfig) -> f64 {
    let surfaces: Vec<usize> = (0..11).collect();
    let batch = Batch {
        tensor: shown(source, surfaces.len() * targets.views()),
        surfaces: surfaces.clone(),
    };
    let step = |at_once| {
        let parts = parts(surfaces.clone(), []);
        let config = in_parts(config.clone(), at_once);
        let trainer = Trainer::new(&without_norms(), targets.clone(), parts, config, 5);
        let mut trainer = trainer.unwrap();
        let (gradients, losses) = trainer.gradients(&batch, 0).unwrap();
        let gradients: Vec<f64> = gradients.iter().flat_map(golden::values).collect();
        (gradients, losses)
    };
    let (whole, losses) = step(None);
    let (sum, of_parts) = step(Some(3));
    let loss = (losses.total() - of_parts.total()).abs() / losses.total().abs();
    assert!(loss < 1e-6, "{losses:?} {of_parts:?}");
    assert!((losses.accuracy - of_parts.accuracy).abs() < 1e-6);
    let differences: Vec<f64> = sum.iter().zip(&whole).map(|(a, b)| a - b).collect();
    golden::norm(&differences) / golden::norm(&whole)
}

/// Readings that are missing make parts count unequally.
#[test]
fn parts_have_the_gradient_of_the_whole_step() {
    let stripes = Stripes::new(11);
    let brightness = stripes.brightness.iter();
    let rows = brightness.map(|&b| vec![Some(b), Some(1.0 - b * b)]);
    let mut rows: Vec<_> = rows.collect();
    (rows[0][0], rows[1][0], rows[4][1]) = (None, None, None);
    let names = vec!["brightness".into(), "darkness".into()];
    let other = Encoder::seeded(without_norms().kind(), 1).unwrap();
    let targets = Targets {
        values: Some(Readings::new(names, &rows).unwrap()),
        kept: Some(Kept::new(other, 3..9, &stripes, 0.5).unwrap()),
        ..stripes.targets()
    };
    let error = differs(&stripes, &targets, &config());
    assert!(error < 1e-5, "linear layers: {error:.1e}");

    let pairs = Pairs::new(11);
    for input in inputs() {
        let targets = pairs.targets_of(&without_norms());
        let config = through_heads(input.clone(), golden::cross_modal());
        let error = differs(&pairs, &targets, &config);
        assert!(error < 1e-5, "{input:?}: {error:.1e}");
    }
}

#[test]
fn parts_are_resumed_and_shared_among_threads_to_the_same_bits() {
    let stripes = Stripes::new(30);
    let config = || in_parts(config(), Some(3));
    let start = start().with_depths(&Depths::All).unwrap();
    let new = || stripes.trainer_from(&start, config());
    let resume = |state: &[u8]| {
        let resumed = stripes.resumed(state, config());
        assert_eq!(resumed.encoder.depths(), &Depths::All);
        resumed
    };
    ends_alike(&stripes, new, resume);
}
