//! One benchmark per stage of the simulator: building a surface, a view of it, and its file.

use std::hint::black_box;
use std::io::Cursor;
use std::time::Duration;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use image::{ExtendedColorType, ImageEncoder};
use sps_dataset::Source;
use sps_simulate::{Material, Simulator, SimulatorSpec, ceilings};

fn spec(surfaces: usize) -> SimulatorSpec {
    SimulatorSpec {
        surfaces,
        size: 128,
        views: 91,
        locations: 1,
        repeats: 1,
        ..SimulatorSpec::default()
    }
}

/// Building a surface for its first view, and a view of a built one, of each class.
fn surfaces_and_views(c: &mut Criterion) {
    let simulator = Simulator::new(spec(200)).expect("the spec is valid");
    // The named classes of the paper's figure 2a.
    for class in Material::all().take(14).map(Material::label) {
        let mut surfaces = simulator.surfaces().iter();
        let surface = surfaces.position(|s| s.material == class).unwrap_or(0);
        c.bench_function(&format!("surface and first view, 128 px, {class}"), |b| {
            b.iter_batched(
                || Simulator::new(spec(surface + 1)).unwrap(),
                |fresh| fresh.frame_bytes(surface, 0).unwrap(),
                BatchSize::PerIteration,
            );
        });
        let mut view = 0;
        c.bench_function(&format!("view, 128 px, {class}"), |b| {
            b.iter(|| {
                view = (view + 7) % 91;
                simulator.frame_bytes(surface, view).unwrap()
            });
        });
    }
}

fn other_stages(c: &mut Criterion) {
    let simulator = Simulator::new(spec(200)).expect("the spec is valid");
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
        b.iter(|| Simulator::new(black_box(spec(200))).unwrap());
    });
    c.bench_function("ceilings of 1000 surfaces", |b| {
        b.iter(|| ceilings(black_box(1), 1000, 3));
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = surfaces_and_views, other_stages
}
criterion_main!(benches);
