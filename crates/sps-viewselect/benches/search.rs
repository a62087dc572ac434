//! What a selection costs, on a frozen late-fusion estimator, and what its parts cost.

#[path = "../tests/suite/problems.rs"]
#[allow(dead_code, reason = "the tests use the rest")]
mod problems;

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use problems::LateFusion;
use sps_viewselect::{
    Equidistant, Exhaustive, Greedy, Nadir, Nvs, Problem, Random, Selector, SetFunction,
    TemporalRelations, VbNvs,
};

const VIEWS: usize = 50;
const PICKS: usize = 3;
const SURFACES: usize = 60;

fn selectors(criterion: &mut Criterion) {
    let loss = LateFusion::new(VIEWS, PICKS, SURFACES, 0);
    let problem = Problem::new(&loss).unwrap_or_else(|error| panic!("{error}"));
    let selectors: [(&str, Box<dyn Selector>); 8] = [
        ("random", Box::new(Random::default())),
        ("random_20000", Box::new(Random { draws: 20_000 })),
        ("nadir", Box::new(Nadir::default())),
        ("equidistant", Box::new(Equidistant::default())),
        ("nvs_20000", Box::new(Nvs::default())),
        ("vb_nvs_20000", Box::new(VbNvs::default())),
        ("greedy", Box::new(Greedy::default())),
        ("exhaustive", Box::new(Exhaustive::default())),
    ];
    let mut group = criterion.benchmark_group("late_fusion_50_views_60_surfaces");
    group.sample_size(10);
    for (name, selector) in selectors {
        group.bench_function(name, |bencher| {
            bencher.iter(|| selector.select(black_box(&problem)));
        });
    }
    group.finish();
}

/// The selectors' own work: a loss that costs nothing.
fn overhead(criterion: &mut Criterion) {
    let loss = SetFunction::new(100, PICKS, |set: &[usize]| set[0] as f64);
    let problem = Problem::new(&loss).unwrap_or_else(|error| panic!("{error}"));
    let mut group = criterion.benchmark_group("free_loss_100_views");
    group.sample_size(10);
    group.bench_function("nvs_20000", |bencher| {
        bencher.iter(|| Nvs::default().select(black_box(&problem)));
    });
    group.bench_function("vb_nvs_20000", |bencher| {
        bencher.iter(|| VbNvs::default().select(black_box(&problem)));
    });
    group.throughput(Throughput::Elements(1_000_000));
    group.bench_function("exhaustive", |bencher| {
        bencher.iter(|| Exhaustive::default().select(black_box(&problem)));
    });
    group.finish();
}

fn relations(criterion: &mut Criterion) {
    let relations = TemporalRelations::default().sampler(100, 0);
    let relations = relations.unwrap_or_else(|error| panic!("{error}"));
    criterion.bench_function("relations_100_views", |bencher| {
        bencher.iter(|| relations.training_step(black_box(3)));
    });
}

criterion_group!(benches, selectors, overhead, relations);
criterion_main!(benches);
