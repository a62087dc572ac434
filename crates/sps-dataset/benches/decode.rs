//! What it takes to have a frame of 256 x 256 pixels, by format, and to name its content.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sps_dataset::{DecodeSettings, FrameFormat, decode_image};

/// The same photograph in each format.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let jpeg = include_bytes!("photo.jpg").to_vec();
    let frame = decode_image(&jpeg, &DecodeSettings::default())
        .expect("the photograph")
        .frame;
    vec![
        ("jpeg", jpeg),
        (
            "png",
            FrameFormat::Png.encode(&frame).expect("an encodable frame"),
        ),
        #[cfg(feature = "exr")]
        (
            "exr-half-zip",
            FrameFormat::Exr.encode(&frame).expect("an encodable frame"),
        ),
    ]
}

fn decode(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("decode");
    group.throughput(Throughput::Elements(256 * 256));
    let settings = DecodeSettings::default();
    for (name, bytes) in files() {
        group.bench_with_input(
            BenchmarkId::from_parameter(name),
            &bytes,
            |bencher, bytes| {
                bencher.iter(|| decode_image(black_box(bytes), &settings));
            },
        );
    }
    group.finish();
}

fn encode(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("encode");
    group.throughput(Throughput::Elements(256 * 256));
    let jpeg = include_bytes!("photo.jpg");
    let frame = decode_image(jpeg, &DecodeSettings::default())
        .expect("the photograph")
        .frame;
    let formats = [
        FrameFormat::Png,
        #[cfg(feature = "exr")]
        FrameFormat::Exr,
    ];
    for format in formats {
        group.bench_function(format.extension(), |bencher| {
            bencher.iter(|| format.encode(black_box(&frame)));
        });
    }
    group.finish();
}

criterion_group!(benches, decode, encode);
criterion_main!(benches);
