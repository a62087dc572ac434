//! The paper's encoder at 224 x 224: forward pass and training step, and a matrix product of as many multiply-adds as
//! one frame needs. The other encoders likewise.
//!
//! `cargo bench -p sps-models --bench encoders`; `docs/kernels.md` says what came out.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use sps_models::Result;
use sps_models::candle::{DType, Device, Result as Computed, Tensor};
use sps_models::encoders::{Encoder, EncoderKind, Precision, TrainableEncoder};

const KIND: EncoderKind = EncoderKind::SeResNext50;

/// Encoders beside the paper's, with the height and width of their images.
const OTHERS: [(EncoderKind, usize); 6] = [
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

fn time_step(
    c: &mut Criterion,
    [group, name]: [&str; 2],
    mut encoder: TrainableEncoder,
    images: &Tensor,
) -> Result<()> {
    let batch = images.dim(0)?;
    let name = format!("{name}, batch {batch}");
    time(c, [group, &name], batch, || {
        let loss = encoder.forward(black_box(images))?.sqr()?.mean_all()?;
        encoder.backward(&loss)
    })
}

fn papers(c: &mut Criterion) -> Result<()> {
    let encoder = Encoder::seeded(KIND, 0)?;
    let bf16 = encoder.clone().with_precision(Precision::Bf16)?;
    let images = |batch| values(&[batch, 3, 224, 224]);
    for batch in [8, 1] {
        let images = images(batch)?;
        let mut forward = |name, pass: &dyn Fn(&Tensor) -> Result<Tensor>| {
            let name = format!("{name}, batch {batch}");
            time(c, ["forward", &name], batch, || pass(black_box(&images)))
        };
        forward("kernels", &|images| encoder.embed(images))?;
        forward("kernels in bf16", &|images| bf16.embed(images))?;
    }
    let trainable = TrainableEncoder::new(&encoder)?;
    time_step(c, ["training step", "kernels"], trainable, &images(8)?)
}

fn others(c: &mut Criterion) -> Result<()> {
    for (kind, extent) in OTHERS {
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
        let trainable = TrainableEncoder::new(&encoder)?;
        time_step(c, [kind.name(), "training step"], trainable, &images(8)?)?;
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
    for group in [papers, others, product] {
        if let Err(error) = group(c) {
            eprintln!("encoders: {error}");
        }
    }
}

criterion_group!(benches, all);
criterion_main!(benches);
