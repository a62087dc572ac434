//! Embeddings against PyTorch's in f64.

mod common;

use candle_core::Tensor;
use common::{encoder, golden, input, relative_error, worst_error};
use sps_models::encoders::{EncoderKind, Precision};

/// f32 against f64: 2e-5 relative, for the vector and for its worst element.
fn assert_close(case: &str, found: &Tensor, expected: &Tensor) {
    let norm = relative_error(found, expected);
    let worst = worst_error(found, expected);
    println!("{case}: relative error {norm:.1e}, of the worst element {worst:.1e}");
    assert!(
        norm < 2e-5 && worst < 2e-5,
        "{case}: {norm:.1e} {worst:.1e}"
    );
}

#[test]
fn se_resnext50_embeds_as_timm_does() {
    let encoder = encoder(EncoderKind::SeResNext50);
    let golden = golden("se_resnext50.safetensors");
    for (case, shape) in [("eval224", [2, 3, 224, 224]), ("eval97", [1, 3, 97, 131])] {
        let images = input(&format!("golden/{case}"), &shape);
        let found = encoder.embed_normalised(&images).unwrap();
        assert_close(case, &found, &golden[&format!("{case}.embedding")]);
    }
}

#[test]
fn squeezenet_embeds_as_torchvision_does() {
    let encoder = encoder(EncoderKind::SqueezeNet1_0);
    let images = input("golden/squeeze", &[2, 3, 224, 224]);
    let found = encoder.embed_normalised(&images).unwrap();
    let expected = &golden("squeezenet1_0.safetensors")["embedding"];
    assert_close("squeeze", &found, expected);
}

/// The networks of `make_golden_encoders.py`, at an odd size.
#[test]
fn other_networks_embed_as_torchvision_and_timm_do() {
    let golden = golden("encoders.safetensors");
    for (kind, name) in [
        (EncoderKind::ResNet18, "resnet18"),
        (EncoderKind::ResNet50, "resnet50"),
        (EncoderKind::SqueezeNet1_1, "squeezenet1_1"),
        (EncoderKind::EfficientNetLite0, "efficientnet_lite0"),
    ] {
        let images = input(&format!("golden/{name}.eval"), &[2, 3, 97, 131]);
        let found = encoder(kind).embed_normalised(&images).unwrap();
        let expected = &golden[&format!("{name}.eval.embedding")];
        let error = relative_error(&found, expected);
        println!("{kind}: relative error {error:.1e}");
        assert!(error < 1e-5, "{kind}: {error:.1e}");
    }
}

/// Numbers of eight bits through 16 bottlenecks; whatever else is in the batch.
#[test]
fn bf16_stays_near_f32() {
    for (kind, case, bound) in [
        (EncoderKind::SeResNext50, "eval224", 5e-3),
        (EncoderKind::SqueezeNet1_0, "squeeze", 5e-3),
        (EncoderKind::ResNet18, "eval224", 5e-3),
        (EncoderKind::EfficientNetLite0, "eval224", 5e-3),
    ] {
        let encoder = encoder(kind);
        let images = input(&format!("golden/{case}"), &[2, 3, 224, 224]);
        let exact = encoder.embed_normalised(&images).unwrap();
        let bf16 = encoder.with_precision(Precision::Bf16).unwrap();
        let found = bf16.embed_normalised(&images).unwrap();
        let error = relative_error(&found, &exact);
        println!("{kind} in bf16: relative error {error:.1e}");
        assert!(error < bound, "{kind}: {error:.1e}");
        let alone = bf16.embed_normalised(&images.get(1).unwrap().unsqueeze(0).unwrap());
        let alone: Vec<Vec<f32>> = alone.unwrap().to_vec2().unwrap();
        assert_eq!(alone[0], found.to_vec2::<f32>().unwrap()[1]);
    }
}
