//! Whole trainings on small images.

mod accumulation;
mod heads;
mod kept;
mod sequences;

use std::error::Error as StdError;

use candle_core::{DType, Tensor};
use sps_base::streams::named_stream;
use sps_regress::Readings;

use super::*;
use crate::encoders::{Depths, Encoder, EncoderKind};
use crate::error::Result;
use crate::golden::{self, on_threads};
use crate::optim::AdamConfig;
use crate::weights::{Storage, Weights};
use rand::Rng;

/// Stripes: even images are striped along, odd ones across; brightness is the value.
struct Stripes {
    brightness: Vec<f64>,
}

impl Stripes {
    fn new(count: usize) -> Self {
        let mut rng = named_stream(1, "stripes", 0);
        let brightness = (0..count).map(|_| rng.random_range(0.3..0.9)).collect();
        Self { brightness }
    }

    fn targets(&self) -> Targets {
        let rows: Vec<_> = self.brightness.iter().map(|&b| vec![Some(b)]).collect();
        Targets {
            values: Some(Readings::new(vec!["brightness".into()], &rows).unwrap()),
            classes: Some(Classes {
                of_image: (0..rows.len() as u32).map(|i| i % 2).collect(),
                count: 2,
            }),
            ..Targets::default()
        }
    }

    fn parts(&self) -> Parts {
        let count = self.brightness.len();
        parts(0..count - 8, count - 8..count)
    }

    fn trainer(&self, config: TrainingConfig) -> Trainer {
        self.trainer_from(&start(), config)
    }

    fn trainer_from(&self, start: &Encoder, config: TrainingConfig) -> Trainer {
        Trainer::new(start, self.targets(), self.parts(), config, 5).unwrap()
    }

    fn resumed(&self, state: &[u8], config: TrainingConfig) -> Trainer {
        let (targets, parts) = (self.targets(), self.parts());
        Trainer::resume("a state", state, targets, parts, config, 5).unwrap()
    }
}

impl ImageSource for Stripes {
    fn image(&self, index: usize) -> Result<Image, Box<dyn StdError + Send + Sync>> {
        const SIDE: usize = 32;
        let bright = self.brightness[index] as f32;
        let pixels = (0..SIDE * SIDE).flat_map(|at| {
            let along = if index.is_multiple_of(2) {
                at / SIDE
            } else {
                at % SIDE
            };
            [bright * if along / 4 % 2 == 0 { 1.0 } else { 0.5 }; 3]
        });
        Ok(Image::new(SIDE, SIDE, pixels.collect())?)
    }
}

fn config() -> TrainingConfig {
    TrainingConfig {
        epochs: 12,
        batch_size: 8,
        adam: AdamConfig {
            learning_rate: 1e-3,
            ..AdamConfig::default()
        },
        clip_norm: Some(5.0),
        // So that they move, and are part of a state.
        running_statistics: Some(false),
        augmentation: Augmentation {
            brightness: 0.0,
            contrast: 0.0,
            colour: 0.0,
            ..Augmentation::default()
        },
        ..TrainingConfig::default()
    }
}

/// A network with batch norm.
fn start() -> Encoder {
    Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0).unwrap()
}

/// One without, which learns in few steps and bounds no map.
fn without_norms() -> Encoder {
    Encoder::seeded(EncoderKind::SqueezeNet1_0, 0).unwrap()
}

/// The first images of a source, as one batch.
fn shown(source: &dyn ImageSource, count: usize) -> Tensor {
    let images: Vec<Image> = (0..count).map(|i| source.image(i).unwrap()).collect();
    batches::stack(&images, &vec![0; count]).unwrap()
}

fn parts(
    training: impl IntoIterator<Item = usize>,
    validation: impl IntoIterator<Item = usize>,
) -> Parts {
    Parts {
        training: training.into_iter().collect(),
        validation: validation.into_iter().collect(),
    }
}

fn epochs(trainer: &mut Trainer, source: &dyn ImageSource, count: usize) {
    for _ in 0..count {
        trainer.epoch(source, |_| ()).unwrap();
    }
}

fn to_the_end(trainer: &mut Trainer, source: &dyn ImageSource) {
    while !trainer.is_finished() {
        trainer.epoch(source, |_| ()).unwrap();
    }
}

fn bytes(trainer: Trainer) -> Vec<u8> {
    let depths = trainer.encoder.depths().clone();
    let encoder = trainer.into_encoder().unwrap();
    assert_eq!(encoder.depths(), &depths);
    encoder.weights().to_bytes().unwrap()
}

#[test]
fn an_encoder_learns_what_its_images_show() {
    let stripes = Stripes::new(64);
    let mut trainer = stripes.trainer_from(&without_norms(), config());
    to_the_end(&mut trainer, &stripes);
    let (first, last) = (&trainer.history()[0], &trainer.history()[11]);
    assert!(last.training.total() < 0.5 * first.training.total());
    let validation = last.validation.unwrap();
    assert!(validation.accuracy > 0.9, "{validation:?}");
}

/// A training of three epochs ends with the same bits on three threads, and where it was stopped after the first
/// and goes on by `resume` from its state on two.
fn ends_alike(
    source: &dyn ImageSource,
    new: impl Fn() -> Trainer + Sync,
    resume: impl Fn(&[u8]) -> Trainer + Sync,
) {
    let run = |threads, stopped: bool| {
        on_threads(threads, || {
            let mut trainer = new();
            epochs(&mut trainer, source, 1);
            if stopped {
                trainer = resume(&trainer.to_bytes().unwrap());
            }
            epochs(&mut trainer, source, 2);
            let (history, state) = (trainer.history().to_vec(), trainer.to_bytes().unwrap());
            (history, state, bytes(trainer))
        })
    };
    let once = run(1, false);
    assert!(once == run(3, false));
    assert!(once == run(2, true));
}

#[test]
fn a_training_that_was_stopped_ends_with_the_same_bits_on_any_threads() {
    let stripes = Stripes::new(40);
    let resume = |state: &[u8]| stripes.resumed(state, config());
    ends_alike(&stripes, || stripes.trainer(config()), resume);
}

#[test]
fn a_state_of_another_training_is_refused() {
    let stripes = Stripes::new(24);
    let mut trainer = stripes.trainer(config());
    epochs(&mut trainer, &stripes, 1);
    let state = trainer.to_bytes().unwrap();
    let resume = |state: &[u8], seed| {
        let (targets, parts) = (stripes.targets(), stripes.parts());
        Trainer::resume("a state", state, targets, parts, config(), seed)
    };
    assert!(resume(&state, 5).is_ok());
    assert!(resume(&state, 6).is_err());
    assert!(resume(&state[..state.len() / 2], 5).is_err());
    assert!(resume(b"nothing", 5).is_err());

    // The state knows targets and parts by their hash, and holds a best network that can be used.
    let refused = |state: &[u8], targets, parts, expected: &str| {
        let resumed = Trainer::resume("a state", state, targets, parts, config(), 5);
        golden::refused(resumed, expected);
    };
    let mut bright = Stripes::new(24);
    bright.brightness[0] += 0.1;
    let other = "a state of these targets and parts";
    refused(&state, bright.targets(), stripes.parts(), other);
    let mut parts = stripes.parts();
    parts.training.swap(0, 1);
    refused(&state, stripes.targets(), parts, other);

    let note = Weights::note("a state", &state, "sps-training").unwrap();
    let mut without = Weights::from_bytes("a state", &state).unwrap();
    assert!(without.remove("best/conv_stem.weight").is_some());
    let note = Some(("sps-training", note.as_str()));
    let without = without.to_bytes_as(Storage::F32, note).unwrap();
    let (targets, parts) = (stripes.targets(), stripes.parts());
    refused(&without, targets, parts, "conv_stem.weight");
}

/// Images that are as they should be in training and beyond all bounds in validation.
struct Blinding<'a>(&'a Stripes);

impl ImageSource for Blinding<'_> {
    fn image(&self, index: usize) -> Result<Image, Box<dyn StdError + Send + Sync>> {
        if self.0.parts().training.contains(&index) {
            return self.0.image(index);
        }
        Ok(Image::new(32, 32, vec![1e22; 32 * 32 * 3])?)
    }
}

/// It would be the best for good, and its state could not be read back.
#[test]
fn a_validation_loss_that_is_not_finite_is_an_error() {
    let stripes = Stripes::new(24);
    let mut trainer = stripes.trainer_from(&without_norms(), config());
    let error = trainer.epoch(&Blinding(&stripes), |_| ()).unwrap_err();
    let message = error.to_string();
    assert!(message.starts_with("validation loss: found"), "{message}");
    let resumed = stripes.resumed(&trainer.to_bytes().unwrap(), config());
    assert!(resumed.history().is_empty());
}

#[test]
fn checkpointing_changes_no_bit() {
    let stripes = Stripes::new(24);
    let run = |checkpointing| {
        let mut config = config();
        config.checkpointing = checkpointing;
        let mut trainer = stripes.trainer(config);
        epochs(&mut trainer, &stripes, 1);
        bytes(trainer)
    };
    assert!(run(false) == run(true));
}

#[test]
fn patience_ends_training_and_the_best_network_is_kept() {
    let stripes = Stripes::new(24);
    let mut config = config();
    (config.patience, config.epochs) = (2, 200);
    let mut trainer = stripes.trainer(config);
    let mut best = None;
    while !trainer.is_finished() {
        let epoch = trainer.epoch(&stripes, |_| ()).unwrap();
        if epoch.best {
            let weights = trainer.encoder.weights().unwrap();
            best = Some((trainer.history().len(), weights.to_bytes().unwrap()));
        }
    }
    let (number, best) = best.unwrap();
    assert_eq!(trainer.history().len(), number + 2);
    assert!(bytes(trainer) == best);
}

#[test]
fn a_frozen_encoder_keeps_its_weights() {
    let stripes = Stripes::new(24);
    let mut config = config();
    config.frozen_epochs = 1;
    let mut trainer = stripes.trainer(config);
    let weight = |trainer: &Trainer| {
        let (_, variable) = trainer.encoder.variables().next().unwrap();
        golden::numbers(variable)
    };
    let before = weight(&trainer);
    epochs(&mut trainer, &stripes, 1);
    assert_eq!(weight(&trainer), before);
    epochs(&mut trainer, &stripes, 1);
    assert_ne!(weight(&trainer), before);
}

#[test]
fn targets_that_do_not_fit_are_refused() {
    let stripes = Stripes::new(24);
    let refused = |targets: Targets, parts: Parts, expected: &str| {
        let trainer = Trainer::new(&start(), targets, parts, config(), 0);
        golden::refused(trainer, expected);
    };
    let none = Targets::default();
    refused(none, stripes.parts(), "values or classes");
    let mut short = stripes.targets();
    short.classes.as_mut().unwrap().of_image.pop();
    refused(short, stripes.parts(), "23");
    let mut wild = stripes.targets();
    wild.classes.as_mut().unwrap().of_image[3] = 2;
    refused(wild, stripes.parts(), "below 2");
    refused(stripes.targets(), parts([0, 24], []), "24");
    refused(stripes.targets(), parts([], [0]), "at least 2");
}
