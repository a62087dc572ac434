//! Whatever bytes a reader of fitted heads or training states is given, it
//! answers within its limits; `fixtures/fuzz` says which.

#[path = "../../../fixtures/fuzz/mod.rs"]
mod fuzz;
#[path = "../../../fixtures/fuzz/surfaces.rs"]
mod surfaces;

use std::error::Error;

use candle_core::{Device, Tensor};
use fuzz::{Damage, broken, damaged, fuzz, nested, said, with_header};
use sps_models::encoders::{Depths, Encoder, EncoderKind};
use sps_models::fitted_from_bytes;
use sps_models::heads::{
    Adversarial, CrossModal, Head, HeadConfig, Input, Model, RelationScale, TrainedHeads,
};
use sps_models::training::{
    Augmentation, Classes, Image, ImageSource, Parts, Targets, Trainer, TrainingConfig,
};
use sps_models::weights::{Storage, Weights};
use sps_regress::kernel_ridge::{KernelRidge, KernelRidgeConfig};
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::stacking::Stacking;
use sps_regress::{Regressor, Views};
use surfaces::Made;

/// A file of a tensor with a note.
fn noted(name: &str, text: &str) -> Vec<u8> {
    let tensor = Tensor::full(0.5_f32, (4, 3), &Device::Cpu).unwrap();
    let weights = Weights::from_tensors("seed", [("layer.weight".to_owned(), tensor)]);
    let note = Some((name, text));
    weights.unwrap().to_bytes_as(Storage::F32, note).unwrap()
}

/// Fitted to all three views.
fn heads(made: &Made, input: Input, model: Model) -> Vec<u8> {
    let plan = made.plan().with_views(&Views::Fixed(vec![0, 1, 2]));
    let head = Head::new(HeadConfig {
        input,
        model,
        epochs: 1,
        ..HeadConfig::default()
    });
    let trained = head.unwrap().train(&made.data(), &plan, &());
    trained.unwrap().to_bytes().unwrap()
}

#[test]
fn trained_heads() {
    let made = Made::new();
    let cross_modal = Model::CrossModal(CrossModal {
        latent: 3,
        hidden: 2,
        adversarial: Some(Adversarial {
            hidden: 2,
            ..Adversarial::default()
        }),
        ..CrossModal::default()
    });
    let files = vec![
        heads(&made, Input::ViewPooling {}, Model::Regression {}),
        heads(&made, Input::LateFusion { views: 3 }, cross_modal),
    ];
    fuzz("trained heads", &broken(files), |bytes| {
        if let Some(heads) = said(TrainedHeads::from_bytes("file", &bytes)) {
            said(heads.predict(&made.embeddings));
        }
    });
    nested("trained heads", |text| {
        let heads = TrainedHeads::from_bytes("file", &noted("sps-heads", &text));
        assert!(said(heads).is_none());
    });
}

/// More slots than can be counted.
#[test]
fn relations_without_end_are_refused() {
    for count in [1 << 32, usize::MAX] {
        let scale = RelationScale {
            views: count,
            relations: count,
        };
        let scales = vec![scale; 2];
        let head = Head::new(HeadConfig {
            input: Input::Relations { scales },
            model: Model::CrossModal(CrossModal::default()),
            ..HeadConfig::default()
        });
        let made = Made::new();
        let trained = head.and_then(|head| head.train(&made.data(), &made.plan(), &()));
        assert!(said(trained).is_none());
    }
}

/// A stack of a kernel ridge, a head, and a stack of a ridge.
#[test]
fn stacks() {
    let made = Made::new();
    let stacking = |members| Stacking::new(members, 2).unwrap();
    let ridge = Ridge::new(RidgeConfig::default()).unwrap();
    let kernel = KernelRidge::new(KernelRidgeConfig::default()).unwrap();
    let head = Head::new(HeadConfig {
        model: Model::Regression {},
        epochs: 1,
        ..HeadConfig::default()
    });
    let stack = stacking(vec![
        Box::new(kernel),
        Box::new(head.unwrap()),
        Box::new(stacking(vec![Box::new(ridge)])),
    ]);
    let file = stack.fit(&made.data(), &made.plan()).unwrap().to_bytes();
    fuzz("stacks", &broken(vec![file.unwrap()]), |bytes| {
        if let Some(stacks) = said(fitted_from_bytes("stacks", "file", &bytes)) {
            said(stacks.predict(&made.embeddings));
        }
    });
}

/// Grey images, darker from one to the next.
struct Greys;

impl ImageSource for Greys {
    fn image(&self, index: usize) -> Result<Image, Box<dyn Error + Send + Sync>> {
        let grey = 0.1 * index as f32;
        Ok(Image::new(8, 8, vec![grey; 8 * 8 * 3])?)
    }
}

#[test]
fn training_states() {
    let start = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 1).unwrap();
    // Without what only deeper maps need, the state is half as large.
    let depths = Depths::Named(vec!["stage-2".to_owned()]);
    let start = start.with_depths(&depths).unwrap();
    let targets = || Targets {
        classes: Some(Classes {
            of_image: vec![0, 1, 0, 1, 0, 1],
            count: 2,
        }),
        ..Targets::default()
    };
    let parts = || Parts {
        training: vec![0, 1, 2, 3],
        validation: vec![4, 5],
    };
    let config = TrainingConfig {
        epochs: 2,
        batch_size: 2,
        patience: 2,
        augmentation: Augmentation {
            crop: 1.0,
            ..Augmentation::default()
        },
        ..TrainingConfig::default()
    };
    let mut trainer = Trainer::new(&start, targets(), parts(), config.clone(), 1).unwrap();
    trainer.epoch(&Greys, |_| {}).unwrap();
    let file = trainer.to_bytes().unwrap();
    let resume =
        |bytes: &[u8]| Trainer::resume("file", bytes, targets(), parts(), config.clone(), 1);
    assert!(resume(&file).is_ok());
    fuzz("training states", &Damage::some(), |damages| {
        let file = with_header(&file, |header| damaged(header, &damages));
        if let Some(trainer) = said(resume(&file)) {
            trainer.is_finished();
            said(trainer.into_encoder());
        }
    });
    // A best epoch, and an epoch's number of steps, that are still to come.
    for key in ["best\\\":[", "steps\\\":"] {
        let late = with_header(&file, |header| {
            let header = String::from_utf8(header).unwrap();
            assert!(header.contains(key), "{header}");
            header.replace(key, &format!("{key}9")).into_bytes()
        });
        assert!(said(resume(&late)).is_none(), "{key}");
    }
    nested("training states", |text| {
        assert!(said(resume(&noted("sps-training", &text))).is_none());
    });
}
