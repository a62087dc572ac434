//! Embeddings of all depths, block by block, against PyTorch's in f64.

use candle_core::Tensor;

use super::{embed_normalised, pass};
use crate::encoders::{Depths, Encoder, EncoderKind, Precision, TrainableEncoder};
use crate::golden::{self, encoder, input, norm, numbers, relative, values};

const KINDS: [EncoderKind; 8] = [
    EncoderKind::ResNet18,
    EncoderKind::ResNet50,
    EncoderKind::SqueezeNet1_0,
    EncoderKind::SqueezeNet1_1,
    EncoderKind::SeResNext50,
    EncoderKind::EfficientNetLite0,
    EncoderKind::EfficientNetLite4,
    EncoderKind::I3d,
];

fn images(kind: EncoderKind) -> Tensor {
    let shape: &[usize] = match kind {
        EncoderKind::I3d => &[1, 3, 5, 37, 29],
        _ => &[1, 3, 97, 131],
    };
    input("golden/depths", shape)
}

fn all_depths(kind: EncoderKind) -> Encoder {
    encoder(kind).with_depths(&Depths::All).unwrap()
}

/// The blocks of an embedding by name, each within `bound` of those of `expected`.
fn assert_near(case: &str, encoder: &Encoder, found: &Tensor, expected: &Tensor, bound: f64) {
    let mut start = 0;
    for block in encoder.blocks() {
        let [found, expected] =
            [found, expected].map(|all| all.narrow(1, start, block.width).unwrap());
        let error = relative(&found, &expected);
        println!("{case}, {}: relative error {error:.1e}", block.name);
        assert!(error < bound, "{case}, {}: {error:.1e}", block.name);
        start += block.width;
    }
    assert_eq!(start, found.dims()[1]);
}

#[test]
fn every_block_is_pytorchs_in_every_precision() {
    let golden = golden::load("depths.safetensors");
    for kind in KINDS {
        let images = images(kind);
        let expected = golden[kind.name()].unsqueeze(0).unwrap();
        let encoder = all_depths(kind);
        let exact = embed_normalised(&encoder, &images);
        assert_near(&format!("{kind}"), &encoder, &exact, &expected, 1e-5);

        // What is calibrated embeds images in 0..=1.
        let images = ((images + 1.0).unwrap() * 0.5).unwrap();
        let exact = encoder.embed(&images).unwrap();
        if !kind.takes_sequences() {
            let plain = encoder.embed_plain(&images).unwrap();
            assert_near(&format!("{kind}, plain"), &encoder, &plain, &exact, 1e-5);
        }
        let encoder = encoder.calibrated(&[&images]).unwrap();
        for (precision, bound) in [(Precision::Bf16, 1e-2), (Precision::Int8, 3e-2)] {
            let encoder = encoder.clone().with_precision(precision).unwrap();
            assert_eq!(encoder.depths(), &Depths::All);
            let found = encoder.embed(&images).unwrap();
            let case = format!("{kind} in {precision}");
            assert_near(&case, &encoder, &found, &exact, bound);
        }
    }
}

/// Some depths are the same blocks to the last bit, in the order of the layers, whatever the batch.
#[test]
fn some_depths_are_blocks_of_all() {
    for kind in KINDS {
        let all = all_depths(kind);
        let images = images(kind);
        let images = Tensor::cat(&[&images, &images.neg().unwrap(), &images], 0).unwrap();
        let whole = embed_normalised(&all, &images);
        let part = |start, width| numbers(&whole.narrow(1, start, width).unwrap());
        let mut start = 0;
        for (at, block) in all.blocks().into_iter().enumerate() {
            let depths = Depths::Named(vec![block.name.clone()]);
            let one = all.clone().with_depths(&depths).unwrap();
            assert_eq!(one.blocks(), std::slice::from_ref(&block));
            let found = numbers(&embed_normalised(&one, &images));
            assert_eq!(found, part(start, block.width), "{kind}, {}", block.name);
            start += block.width;
            let frames = if kind.takes_sequences() { 5 } else { 1 };
            let costs = [&one, &all].map(|encoder| encoder.multiply_adds([frames, 97, 131]));
            assert_eq!(costs[0] == costs[1], at + 1 == all.blocks().len(), "{kind}");
        }
        let last = embed_normalised(&encoder(kind), &images);
        let width = last.dims()[1];
        let expected = part(start - width, width);
        assert_eq!(numbers(&last), expected, "{kind}, last");
    }
}

#[test]
fn gradients_come_in_at_every_depth() {
    let golden = golden::load("depths.safetensors");
    for kind in [EncoderKind::ResNet18, EncoderKind::EfficientNetLite0] {
        let start = all_depths(kind);
        let images = input("golden/depths.train.2", &[4, 3, 64, 64]);
        let expected = values(&golden[&format!("{kind}.norms")]);
        for checkpointing in [false, true] {
            let encoder = TrainableEncoder::new(&start).unwrap();
            let mut encoder = encoder.with_checkpointing(checkpointing);
            let (_, _, gradients) = pass(&mut encoder, &images, "golden/depths.cotangent");
            assert_eq!(gradients.len(), expected.len());
            let pairs = gradients.iter().zip(&expected);
            let off = pairs.map(|((_, f), e)| (norm(&values(f)) - e).abs() / e.max(1e-9));
            let worst = off.fold(0.0, f64::max);
            println!("{kind}: gradients' norms {worst:.1e}");
            assert!(worst < 1e-4, "{kind}: {worst:.1e}");
        }
    }
}

/// Layers behind the last depth are not trained, and come out as they went in.
#[test]
fn training_leaves_what_no_depth_needs() {
    let depths = Depths::Named(vec!["stage-1".into(), "stage-2".into()]);
    let start = encoder(EncoderKind::ResNet18).with_depths(&depths).unwrap();
    let trained = TrainableEncoder::new(&start).unwrap();
    let names: Vec<&str> = trained.variables().map(|(name, _)| name).collect();
    assert!(names.iter().any(|name| name.starts_with("layer2.")));
    assert!(!names.iter().any(|name| name.starts_with("layer3.")));
    let again = trained.encoder().unwrap();
    assert_eq!(again.depths(), &depths);
    assert_eq!(again.content_hash(), start.content_hash());
}

#[test]
fn depths_that_cannot_be_meant_are_refused() {
    let start = Encoder::seeded(EncoderKind::ResNet18, 0).unwrap();
    let named = |names: &[&str]| Depths::Named(names.iter().map(|&name| name.into()).collect());
    let unknown = "found \"stage-9\", expected some of resnet18's stage-1, stage-2";
    for (names, expected) in [
        (&["stage-9"][..], unknown),
        (&["stage-1", "stage-1"], "found \"stage-1\" twice"),
        (&[], "depths: found none"),
    ] {
        golden::refused(start.clone().with_depths(&named(names)), expected);
    }
    let hashes = [Depths::Last, Depths::All].map(|d| start.clone().with_depths(&d).unwrap());
    assert_ne!(hashes[0].content_hash(), hashes[1].content_hash());
    assert_eq!(hashes[0].content_hash(), start.content_hash());
}
