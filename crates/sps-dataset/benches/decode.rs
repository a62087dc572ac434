//! What it takes to have a frame of 256 x 256 pixels, by format, and to make a file of it.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use sps_dataset::{DecodeSettings, FrameFormat, decode_image};

/// Of one photograph as a JPEG and in each format that is written.
fn formats(criterion: &mut Criterion) {
    let settings = DecodeSettings::default();
    let jpeg = include_bytes!("photo.jpg").to_vec();
    let frame = decode_image(&jpeg, &settings).expect("a photograph").frame;
    let written = [
        ("png", FrameFormat::Png),
        #[cfg(feature = "exr")]
        ("exr-half-zip", FrameFormat::Exr),
    ];
    let mut files = vec![("jpeg", jpeg)];
    let mut encode = criterion.benchmark_group("encode");
    encode.throughput(Throughput::Elements(256 * 256));
    for (name, format) in written {
        encode.bench_function(format.extension(), |bencher| {
            bencher.iter(|| format.encode(black_box(&frame)));
        });
        files.push((name, format.encode(&frame).expect("an encodable frame")));
    }
    encode.finish();
    let mut decode = criterion.benchmark_group("decode");
    decode.throughput(Throughput::Elements(256 * 256));
    for (name, bytes) in files {
        decode.bench_function(name, |bencher| {
            bencher.iter(|| decode_image(black_box(&bytes), &settings));
        });
    }
    decode.finish();
}

criterion_group!(benches, formats);
criterion_main!(benches);
