//! Training the paper's whole network for fifteen properties from embeddings of 400 surfaces, in short;
//! ridge regression beside it.
//!
//! `cargo bench -p sps-models --bench heads`.

use criterion::{Criterion, criterion_group, criterion_main};
use sps_models::Result;
use sps_models::heads::{Adversarial, Classification, CrossModal, Head, HeadConfig, Model};
use sps_models::labels::LabelSource;
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::{Embeddings, Plan, Readings, Rerun, TrainingData};

const SURFACES: usize = 400;
const WIDTH: usize = 512;
const PROPERTIES: usize = 15;

/// A value in 0..1 that is different for every index.
fn value(index: usize) -> f64 {
    (index as f64 * 0.618_033_988_749_894_9).fract()
}

fn heads(c: &mut Criterion) -> Result<()> {
    let embeddings = (0..SURFACES * WIDTH).map(|i| value(i * i) as f32);
    let row = |s: usize| {
        let readings = (0..PROPERTIES).map(|p| Some(100.0 * value(s * 31 + p * s)));
        readings.collect::<Vec<_>>()
    };
    let table: Vec<_> = (0..SURFACES).map(row).collect();
    let names: Vec<String> = (0..PROPERTIES).map(|p| format!("p{p}")).collect();
    let readings = Readings::new(names.clone(), &table)?;
    let embeddings = Embeddings::new(embeddings.collect(), [SURFACES, 1, WIDTH])?;
    let data = TrainingData::new(&embeddings, &readings);
    let rerun = Rerun::new(0, (0..SURFACES).filter(|s| !s.is_multiple_of(10)));
    let plan = Plan::each(1, &names, vec![rerun]);
    let head = Head::new(HeadConfig {
        epochs: 3,
        model: Model::CrossModal(CrossModal {
            adversarial: Some(Adversarial::default()),
            classification: Some(Classification::new(LabelSource::VisuoTactileCluster {
                clusters: 15,
                components: 15,
                standardise_tactile: true,
            })),
            ..CrossModal::default()
        }),
        ..HeadConfig::default()
    })?;
    head.train(&data, &plan, &())?;
    let mut group = c.benchmark_group("heads");
    group.sample_size(10);
    group.bench_function("short: full model, 15 properties, 1 rerun, 3 epochs", |b| {
        b.iter(|| head.train(&data, &plan, &()));
    });
    let ridge = Ridge::new(RidgeConfig::default())?;
    group.bench_function("short: ridge, 15 properties, 1 rerun", |b| {
        b.iter(|| ridge.train(&data, &plan));
    });
    group.finish();
    Ok(())
}

fn benches(c: &mut Criterion) {
    if let Err(error) = heads(c) {
        eprintln!("heads: {error}");
    }
}

criterion_group!(all, benches);
criterion_main!(all);
