//! Embeddings against PyTorch's in f64.

mod common;

use candle_core::Tensor;
use common::{encoder, golden, input, relative_error, worst_error};
use sps_models::encoders::EncoderKind;

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
