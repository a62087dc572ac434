//! The paper's encoder at 224 x 224: forward pass and training step, by the kernels and by
//! candle's own operators, and a matrix product of as many multiply-adds as one frame needs. The
//! other encoders likewise, by the kernels alone.
//!
//! `cargo bench -p sps-models --bench encoders`; `docs/kernels.md` says what came out.

use std::hint::black_box;

use candle_core::{DType, Device, Result, Tensor};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use sps_models::encoders::{Encoder, EncoderKind, Precision, TrainableEncoder};

const KIND: EncoderKind = EncoderKind::SeResNext50;

fn images(batch: usize) -> Result<Tensor> {
    values(&[batch, 3, 224, 224])
}

fn values(shape: &[usize]) -> Result<Tensor> {
    let count: usize = shape.iter().product();
    let ramp = Tensor::arange(0.0_f32, count as f32, &Device::Cpu)?;
    let values = (ramp * 0.37)?.sin()?.affine(0.5, 0.5)?;
    values.reshape(shape)
}

fn forward(c: &mut Criterion) -> sps_models::Result<()> {
    let encoder = Encoder::seeded(KIND, 0)?;
    let bf16 = encoder.clone().with_precision(Precision::Bf16)?;
    let mut group = c.benchmark_group("forward");
    group.sample_size(10);
    for batch in [8, 1] {
        let images = images(batch)?;
        // What fails would be fast: once beforehand.
        encoder.embed(&images)?;
        bf16.embed(&images)?;
        encoder.embed_plain(&images)?;
        group.throughput(Throughput::Elements(batch as u64));
        group.bench_function(format!("kernels, batch {batch}"), |b| {
            b.iter(|| encoder.embed(black_box(&images)));
        });
        group.bench_function(format!("kernels in bf16, batch {batch}"), |b| {
            b.iter(|| bf16.embed(black_box(&images)));
        });
        group.bench_function(format!("plain operators, batch {batch}"), |b| {
            b.iter(|| encoder.embed_plain(black_box(&images)));
        });
    }
    group.finish();
    Ok(())
}

fn step(encoder: &mut TrainableEncoder, images: &Tensor) -> sps_models::Result<()> {
    let loss = encoder.forward(images)?.sqr()?.mean_all()?;
    black_box(encoder.backward(&loss)?);
    Ok(())
}

fn training(c: &mut Criterion) -> sps_models::Result<()> {
    let start = Encoder::seeded(KIND, 0)?;
    let mut group = c.benchmark_group("training step");
    group.sample_size(10);
    // Candle's operators keep so much of each frame that eight do not fit everywhere.
    for (name, batch, plain) in [("kernels", 8, false), ("plain operators", 2, true)] {
        let mut encoder = TrainableEncoder::new(&start)?;
        if plain {
            encoder = encoder.with_plain_operators();
        }
        let images = images(batch)?;
        step(&mut encoder, &images)?;
        group.throughput(Throughput::Elements(batch as u64));
        group.bench_function(format!("{name}, batch {batch}"), |b| {
            b.iter(|| step(&mut encoder, black_box(&images)));
        });
    }
    group.finish();
    Ok(())
}

/// Encoders beside the paper's, with the height and width of their images.
const OTHERS: [(EncoderKind, usize); 6] = [
    (EncoderKind::EfficientNetLiteBody, 128),
    (EncoderKind::SqueezeNet1_0, 224),
    (EncoderKind::SqueezeNet1_1, 224),
    (EncoderKind::ResNet18, 224),
    (EncoderKind::ResNet50, 224),
    (EncoderKind::EfficientNetLite0, 224),
];

/// Images of a training step.
const BATCH: usize = 8;

fn others(c: &mut Criterion) -> sps_models::Result<()> {
    for (kind, extent) in OTHERS {
        let encoder = Encoder::seeded(kind, 0)?;
        let bf16 = encoder.clone().with_precision(Precision::Bf16)?;
        let mut group = c.benchmark_group(kind.name());
        group.sample_size(10);
        for batch in [8, 1] {
            let images = values(&[batch, 3, extent, extent])?;
            encoder.embed(&images)?;
            group.throughput(Throughput::Elements(batch as u64));
            group.bench_function(format!("forward, batch {batch}"), |b| {
                b.iter(|| encoder.embed(black_box(&images)));
            });
            group.bench_function(format!("forward in bf16, batch {batch}"), |b| {
                b.iter(|| bf16.embed(black_box(&images)));
            });
        }
        let images = values(&[BATCH, 3, extent, extent])?;
        let mut trainable = TrainableEncoder::new(&encoder)?;
        step(&mut trainable, &images)?;
        group.throughput(Throughput::Elements(BATCH as u64));
        group.bench_function(format!("training step, batch {BATCH}"), |b| {
            b.iter(|| step(&mut trainable, black_box(&images)));
        });
        group.finish();
    }
    sequences(c)
}

/// A short sequence.
fn sequences(c: &mut Criterion) -> sps_models::Result<()> {
    const FRAMES: usize = 16;
    let sequence = values(&[1, 3, FRAMES, 224, 224])?;
    let encoder = Encoder::seeded(EncoderKind::I3d, 0)?;
    let mut group = c.benchmark_group(EncoderKind::I3d.name());
    group.sample_size(10);
    group.throughput(Throughput::Elements(FRAMES as u64));
    group.bench_function(format!("forward, {FRAMES} frames"), |b| {
        b.iter(|| encoder.embed(black_box(&sequence)));
    });
    group.finish();
    Ok(())
}

/// The roof: 4.2 G multiply-adds as one product of candle's.
fn product(c: &mut Criterion) -> sps_models::Result<()> {
    let (m, k, n) = (3584, 1024, 1152);
    let left = Tensor::ones((m, k), DType::F32, &Device::Cpu)?;
    let right = Tensor::ones((k, n), DType::F32, &Device::Cpu)?;
    let mut group = c.benchmark_group("matrix product");
    group.sample_size(10);
    group.throughput(Throughput::Elements(1));
    group.bench_function(format!("{m} x {k} x {n}"), |b| {
        b.iter(|| black_box(&left).matmul(black_box(&right)));
    });
    group.finish();
    Ok(())
}

/// Runs a group whose set-up can fail.
macro_rules! checked {
    ($($name:ident => $group:ident),*) => {$(
        fn $name(c: &mut Criterion) {
            if let Err(error) = $group(c) {
                eprintln!("{}: {error}", stringify!($group));
            }
        }
    )*};
}

checked!(
    bench_forward => forward,
    bench_training => training,
    bench_others => others,
    bench_product => product
);

criterion_group!(
    benches,
    bench_forward,
    bench_training,
    bench_others,
    bench_product
);
criterion_main!(benches);
