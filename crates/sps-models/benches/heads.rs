//! Training the paper's seven ablation rows, fifteen properties and three reruns each, for 30
//! epochs from embeddings of 400 surfaces; and in short, the full model and ridge regression for one
//! rerun.
//!
//! `cargo bench -p sps-models --bench heads`.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use sps_models::Result;
use sps_models::heads::{Adversarial, Classification, CrossModal, Head, HeadConfig, Model};
use sps_models::labels::LabelSource;
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::{Embeddings, Plan, Readings, Rerun, TrainingData};

const SURFACES: usize = 400;
const WIDTH: usize = 512;
const PROPERTIES: usize = 15;

/// The seven rows of the paper's table 4.
fn rows() -> Vec<Model> {
    let with = |adversarial: bool, labels: Option<LabelSource>| {
        Model::CrossModal(CrossModal {
            adversarial: adversarial.then(Adversarial::default),
            classification: labels.map(Classification::new),
            ..CrossModal::default()
        })
    };
    let tactile = LabelSource::TactileCluster {
        clusters: 15,
        standardise_tactile: true,
    };
    let visuo_tactile = || LabelSource::VisuoTactileCluster {
        clusters: 15,
        components: 15,
        standardise_tactile: true,
    };
    vec![
        Model::Regression {},
        with(false, None),
        with(true, None),
        with(false, Some(LabelSource::Material {})),
        with(false, Some(tactile)),
        with(false, Some(visuo_tactile())),
        with(true, Some(visuo_tactile())),
    ]
}

/// A value in 0..1 that is different for every index.
fn value(index: usize) -> f64 {
    (index as f64 * 0.618_033_988_749_894_9).fract()
}

fn train(rows: &[Model], epochs: usize, data: &TrainingData<'_>, plan: &Plan) -> Result<()> {
    for model in rows {
        let head = Head::new(HeadConfig {
            epochs,
            model: model.clone(),
            ..HeadConfig::default()
        })?;
        black_box(head.train(data, plan, &())?);
    }
    Ok(())
}

fn ablation(c: &mut Criterion) -> Result<()> {
    let embeddings = (0..SURFACES * WIDTH).map(|i| value(i * i) as f32);
    let row = |s: usize| {
        let readings = (0..PROPERTIES).map(|p| Some(100.0 * value(s * 31 + p * s)));
        readings.collect::<Vec<_>>()
    };
    let table: Vec<_> = (0..SURFACES).map(row).collect();
    let names: Vec<String> = (0..PROPERTIES).map(|p| format!("p{p}")).collect();
    let readings = Readings::new(names.clone(), &table)?;
    let embeddings = Embeddings::new(embeddings.collect(), [SURFACES, 1, WIDTH])?;
    let materials: Vec<String> = (0..SURFACES).map(|s| format!("m{}", s % 15)).collect();
    let data = TrainingData::new(&embeddings, &readings).with_materials(&materials);
    let rerun = |number: u64| {
        let kept = |s: &usize| !(*s as u64 + number).is_multiple_of(10);
        Rerun::new(number, (0..SURFACES).filter(kept))
    };
    let plan = Plan::each(1, &names, (0..3).map(rerun).collect());
    let rows = rows();
    let mut group = c.benchmark_group("heads");
    group.sample_size(10);
    group.bench_function("seven rows, 15 properties, 3 reruns, 30 epochs", |b| {
        b.iter(|| train(&rows, 30, &data, &plan));
    });
    let one = Plan::each(1, &names, vec![rerun(0)]);
    let full = &rows[rows.len() - 1..];
    group.bench_function("short: full model, 15 properties, 1 rerun, 3 epochs", |b| {
        b.iter(|| train(full, 3, &data, &one));
    });
    let ridge = Ridge::new(RidgeConfig::default())?;
    group.bench_function("short: ridge, 15 properties, 1 rerun", |b| {
        b.iter(|| ridge.train(&data, &one));
    });
    group.finish();
    Ok(())
}

fn benches(c: &mut Criterion) {
    if let Err(error) = ablation(c) {
        eprintln!("heads: {error}");
    }
}

criterion_group!(all, benches);
criterion_main!(all);
