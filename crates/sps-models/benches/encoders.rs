//! Forward pass and training step of each encoder, and a matrix product of as many multiply-adds as one frame of the
//! paper's needs.
//!
//! `cargo bench -p sps-models --bench encoders`; `docs/kernels.md` says what came out.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use sps_models::Result;
use sps_models::candle::{DType, Device, Result as Computed, Tensor};
use sps_models::encoders::{Encoder, EncoderKind, Precision, TrainableEncoder};

/// Encoders, the paper's first, with the height and width of their images.
const ENCODERS: [(EncoderKind, usize); 7] = [
    (EncoderKind::SeResNext50, 224),
    (EncoderKind::EfficientNetLiteBody, 128),
    (EncoderKind::SqueezeNet1_0, 224),
    (EncoderKind::SqueezeNet1_1, 224),
    (EncoderKind::ResNet18, 224),
    (EncoderKind::ResNet50, 224),
    (EncoderKind::EfficientNetLite0, 224),
];

/// Frames of a short sequence.
const FRAMES: usize = 16;

fn values(shape: &[usize]) -> Computed<Tensor> {
    let count: usize = shape.iter().product();
    let ramp = Tensor::arange(0.0_f32, count as f32, &Device::Cpu)?;
    let values = (ramp * 0.37)?.sin()?.affine(0.5, 0.5)?;
    values.reshape(shape)
}

/// Times a pass over so many images, after one beforehand: what fails would be fast.
fn time<T>(
    c: &mut Criterion,
    [group, name]: [&str; 2],
    images: usize,
    mut pass: impl FnMut() -> Result<T>,
) -> Result<()> {
    pass()?;
    let mut group = c.benchmark_group(group);
    group.sample_size(10);
    group.throughput(Throughput::Elements(images as u64));
    group.bench_function(name, |b| b.iter(&mut pass));
    group.finish();
    Ok(())
}

fn encoders(c: &mut Criterion) -> Result<()> {
    for (kind, extent) in ENCODERS {
        let encoder = Encoder::seeded(kind, 0)?;
        let bf16 = encoder.clone().with_precision(Precision::Bf16)?;
        let images = |batch| values(&[batch, 3, extent, extent]);
        for batch in [8, 1] {
            let images = images(batch)?;
            for (name, encoder) in [("forward", &encoder), ("forward in bf16", &bf16)] {
                let name = format!("{name}, batch {batch}");
                let pass = || encoder.embed(black_box(&images));
                time(c, [kind.name(), &name], batch, pass)?;
            }
        }
        let (mut trainable, images) = (TrainableEncoder::new(&encoder)?, images(8)?);
        time(c, [kind.name(), "training step, batch 8"], 8, || {
            let loss = trainable.forward(black_box(&images))?;
            trainable.backward(&loss.sqr()?.mean_all()?)
        })?;
    }
    let sequence = values(&[1, 3, FRAMES, 224, 224])?;
    let encoder = Encoder::seeded(EncoderKind::I3d, 0)?;
    let name = format!("forward, {FRAMES} frames");
    let pass = || encoder.embed(black_box(&sequence));
    time(c, [EncoderKind::I3d.name(), &name], FRAMES, pass)
}

/// The roof: 4.2 G multiply-adds as one product of candle's.
fn product(c: &mut Criterion) -> Result<()> {
    let (m, k, n) = (3584, 1024, 1152);
    let left = Tensor::ones((m, k), DType::F32, &Device::Cpu)?;
    let right = Tensor::ones((k, n), DType::F32, &Device::Cpu)?;
    let name = format!("{m} x {k} x {n}");
    let pass = || Ok(black_box(&left).matmul(black_box(&right))?);
    time(c, ["matrix product", &name], 1, pass)
}

fn all(c: &mut Criterion) {
    for group in [encoders, product] {
        if let Err(error) = group(c) {
            eprintln!("encoders: {error}");
        }
    }
}

criterion_group!(benches, all);
criterion_main!(benches);
