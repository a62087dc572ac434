//! One benchmark per stage of the simulator: building a surface, a view of it, and its file.

use std::hint::black_box;
use std::io::Cursor;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use image::{ExtendedColorType, ImageEncoder};
use sps_dataset::Source;
use sps_dataset::simulate::{Simulator, SimulatorSpec, ceilings};

/// One class without relief, one with a weave, one with parallax.
const MATERIALS: [&str; 3] = ["plastic", "denim", "carpet"];

fn spec(size: usize) -> SimulatorSpec {
    SimulatorSpec {
        surfaces: 200,
        size,
        views: 91,
        locations: 1,
        repeats: 1,
        ..SimulatorSpec::default()
    }
}

fn surface_of(simulator: &Simulator, material: &str) -> usize {
    let mut surfaces = simulator.surfaces().iter();
    surfaces.position(|s| s.material == material).unwrap_or(0)
}

fn stages(c: &mut Criterion) {
    let simulator = Simulator::new(spec(128)).expect("the spec is valid");
    for material in MATERIALS {
        let surface = surface_of(&simulator, material);
        c.bench_function(
            &format!("surface and first view, 128 px, {material}"),
            |b| {
                b.iter_batched(
                    || {
                        Simulator::new(SimulatorSpec {
                            surfaces: surface + 1,
                            ..spec(128)
                        })
                        .unwrap()
                    },
                    |fresh| fresh.frame_bytes(surface, 0).unwrap(),
                    BatchSize::PerIteration,
                );
            },
        );
        let mut view = 0;
        c.bench_function(&format!("view, 128 px, {material}"), |b| {
            b.iter(|| {
                view = (view + 7) % 91;
                simulator.frame_bytes(surface, view).unwrap()
            });
        });
    }
    let bytes = simulator.frame_bytes(0, 45).expect("the view exists");
    c.bench_function("PNG of a view, 128 px", |b| {
        b.iter(|| {
            let mut file = Cursor::new(Vec::new());
            image::codecs::png::PngEncoder::new(&mut file)
                .write_image(black_box(&bytes), 128, 128, ExtendedColorType::Rgb8)
                .unwrap();
            file
        });
    });
    c.bench_function("touching 200 surfaces", |b| {
        b.iter(|| Simulator::new(black_box(spec(128))).unwrap());
    });
    c.bench_function("ceilings of 1000 surfaces", |b| {
        b.iter(|| ceilings(black_box(1), 1000, 3));
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10);
    targets = stages
}
criterion_main!(benches);
