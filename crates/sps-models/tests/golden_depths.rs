//! Embeddings of all depths, block by block, against PyTorch's in f64.

mod common;

use candle_core::{DType, Tensor};
use common::{encoder, golden, input, relative_error};
use sps_models::encoders::{Depths, Encoder, EncoderKind, Precision, TrainableEncoder};

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

/// The blocks of an embedding by name, each within `bound` of those of `expected`.
fn assert_near(case: &str, encoder: &Encoder, found: &Tensor, expected: &Tensor, bound: f64) {
    let mut start = 0;
    for block in encoder.blocks() {
        let [found, expected] =
            [found, expected].map(|all| all.narrow(1, start, block.width).unwrap());
        let error = relative_error(&found, &expected.to_dtype(DType::F64).unwrap());
        println!("{case}, {}: relative error {error:.1e}", block.name);
        assert!(error < bound, "{case}, {}: {error:.1e}", block.name);
        start += block.width;
    }
    assert_eq!(start, found.dims()[1]);
}

#[test]
fn every_block_is_pytorchs_in_every_precision() {
    let golden = golden("depths.safetensors");
    for kind in KINDS {
        let images = images(kind);
        let expected = golden[kind.name()].unsqueeze(0).unwrap();
        let encoder = encoder(kind).with_depths(&Depths::All).unwrap();
        let exact = encoder.embed_normalised(&images).unwrap();
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
        let all = encoder(kind).with_depths(&Depths::All).unwrap();
        let images = images(kind);
        let images = Tensor::cat(&[&images, &images.neg().unwrap(), &images], 0).unwrap();
        let expected = all.embed_normalised(&images).unwrap();
        let mut start = 0;
        for (at, block) in all.blocks().into_iter().enumerate() {
            let depths = Depths::Named(vec![block.name.clone()]);
            let one = all.clone().with_depths(&depths).unwrap();
            assert_eq!(one.blocks(), std::slice::from_ref(&block));
            let found = one.embed_normalised(&images).unwrap();
            let expected = expected.narrow(1, start, block.width).unwrap();
            let [found, expected] = [found, expected].map(|t| t.to_vec2::<f32>().unwrap());
            assert_eq!(found, expected, "{kind}, {}", block.name);
            start += block.width;
            let frames = if kind.takes_sequences() { 5 } else { 1 };
            let costs = [&one, &all].map(|encoder| encoder.multiply_adds([frames, 97, 131]));
            assert_eq!(costs[0] == costs[1], at + 1 == all.blocks().len(), "{kind}");
        }
        let last = encoder(kind).embed_normalised(&images).unwrap();
        let width = last.dims()[1];
        let expected = expected.narrow(1, start - width, width).unwrap();
        let [found, expected] = [last, expected].map(|t| t.to_vec2::<f32>().unwrap());
        assert_eq!(found, expected, "{kind}, last");
    }
}

#[test]
fn gradients_come_in_at_every_depth() {
    let golden = golden("depths.safetensors");
    for kind in [EncoderKind::ResNet18, EncoderKind::EfficientNetLite0] {
        let start = encoder(kind).with_depths(&Depths::All).unwrap();
        let images = input("golden/depths.train.2", &[4, 3, 64, 64]);
        let expected: Vec<f64> = golden[&format!("{kind}.norms")].to_vec1().unwrap();
        for checkpointing in [false, true] {
            let encoder = TrainableEncoder::new(&start).unwrap();
            let mut encoder = encoder.with_checkpointing(checkpointing);
            let embedding = encoder.forward_normalised(&images).unwrap();
            let cotangent = input("golden/depths.cotangent", embedding.dims());
            let loss = (embedding * cotangent).unwrap().mean_all().unwrap();
            let gradients = encoder.backward(&loss).unwrap();
            let norm = |tensor: &Tensor| {
                let tensor = tensor.to_dtype(DType::F64).unwrap();
                let squares = tensor.sqr().unwrap().sum_all().unwrap();
                squares.to_scalar::<f64>().unwrap().sqrt()
            };
            let found = encoder
                .variables()
                .map(|(_, v)| norm(gradients.get(v).unwrap()));
            let found: Vec<f64> = found.collect();
            assert_eq!(found.len(), expected.len());
            let off = found
                .iter()
                .zip(&expected)
                .map(|(f, e)| (f - e).abs() / e.max(1e-9));
            let worst = off.fold(0.0, f64::max);
            println!("{kind}: gradients' norms {worst:.1e}");
            assert!(worst < 1e-4, "{kind}: {worst:.1e}");
        }
    }
}

/// Layers behind the last depth are not trained, and come out as they went in.
#[test]
fn training_leaves_what_no_depth_needs() {
    let start = encoder(EncoderKind::ResNet18);
    let depths = Depths::Named(vec!["stage-1".into(), "stage-2".into()]);
    let start = start.with_depths(&depths).unwrap();
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
    for (names, expected) in [
        (
            &["stage-9"][..],
            "found \"stage-9\", expected some of resnet18's stage-1, stage-2",
        ),
        (&["stage-1", "stage-1"], "found \"stage-1\" twice"),
        (&[], "depths: found none"),
    ] {
        let error = start.clone().with_depths(&named(names)).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    }
    let hashes = [Depths::Last, Depths::All].map(|d| start.clone().with_depths(&d).unwrap());
    assert_ne!(hashes[0].content_hash(), hashes[1].content_hash());
    assert_eq!(hashes[0].content_hash(), start.content_hash());
}
