mod configuration;
mod divergence;
mod equality;
mod fusion;
mod gradients;
mod hard_cases;
mod learning;
mod plans;
mod regressor;
mod stopping;
mod storage;

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use candle_core::{Device, Tensor};
use sps_regress::{DivergedTrial, Embeddings, Estimates, Readings, Rerun, Trial};

use super::*;
use crate::golden::{self, on_threads, uniform};
use crate::labels::LabelSource;

/// A small data set of which half the variation of each property can be seen.
pub(super) struct Set {
    pub(super) embeddings: Embeddings,
    pub(super) readings: Readings,
    pub(super) materials: Vec<String>,
}

impl Set {
    pub(super) fn new(surfaces: usize, views: usize, width: usize, properties: usize) -> Self {
        let seen = uniform("heads.seen", surfaces * views * width);
        let noise = uniform("heads.noise", surfaces * properties);
        let mixing = uniform("heads.mixing", width * properties);
        let reading = |s: usize, p: usize| {
            let mixed = seen[s * views * width..][..width].iter().enumerate();
            let sum: f64 = mixed.map(|(f, x)| x * mixing[f * properties + p]).sum();
            Some(40.0 + 10.0 * sum + 5.0 * noise[s * properties + p])
        };
        let row = |s| (0..properties).map(|p| reading(s, p)).collect();
        let rows: Vec<Vec<_>> = (0..surfaces).map(row).collect();
        let seen: Vec<f32> = seen.iter().map(|&x| x as f32).collect();
        let names = (0..properties).map(|p| format!("p{p}")).collect();
        Self {
            embeddings: Embeddings::new(seen, [surfaces, views, width]).unwrap(),
            readings: Readings::new(names, &rows).unwrap(),
            materials: (0..surfaces).map(|s| format!("m{}", s % 4)).collect(),
        }
    }

    pub(super) fn data(&self) -> TrainingData<'_> {
        TrainingData::new(&self.embeddings, &self.readings).with_materials(&self.materials)
    }

    /// Reruns that keep another tenth of the surfaces out each.
    pub(super) fn plan(&self, reruns: u64) -> Plan {
        let surfaces = 0..self.embeddings.surfaces();
        let rerun = |number: u64| {
            let kept = |s: &usize| !(*s as u64 + number).is_multiple_of(10);
            Rerun::new(number, surfaces.clone().filter(kept))
        };
        let reruns = (0..reruns).map(rerun).collect();
        Plan::each(11, self.readings.properties(), reruns)
    }

    /// Makes other readings of each surface's own.
    pub(super) fn reread(&mut self, row: impl Fn(usize, &[Option<f64>]) -> Vec<Option<f64>>) {
        let rows = (0..self.readings.surfaces()).map(|s| row(s, self.readings.row(s).unwrap()));
        let names = self.readings.properties().to_vec();
        self.readings = Readings::new(names, &rows.collect::<Vec<_>>()).unwrap();
    }

    pub(super) fn train(&self, config: &HeadConfig, plan: &Plan) -> TrainedHeads {
        let head = Head::new(config.clone()).unwrap();
        head.train(&self.data(), plan, &()).unwrap()
    }

    /// One trial of a plan, trained without the others.
    pub(super) fn alone(&self, config: &HeadConfig, plan: &Plan, trial: &Trial) -> TrainedHead {
        let trials = vec![trial.clone()];
        let plan = Plan {
            trials,
            ..plan.clone()
        };
        self.train(config, &plan).heads.remove(0)
    }

    /// A training is refused for a reason with `expected` in it.
    #[track_caller]
    pub(super) fn refuses(&self, config: HeadConfig, plan: &Plan, expected: &str) {
        let head = Head::new(config).unwrap();
        golden::refused(head.train(&self.data(), plan, &()), expected);
    }
}

/// What an observer hears.
#[derive(Default)]
pub(super) struct Record {
    /// How often a stack has asked whether to stop: once before each of its epochs.
    pub(super) asked: AtomicUsize,
    /// How many of these questions are answered with no; all, where there is none.
    pub(super) stops_after: Option<usize>,
    pub(super) diverged: Mutex<Vec<DivergedTrial>>,
    pub(super) finished: Mutex<Vec<Trial>>,
}

impl Observer for Record {
    fn stops(&self) -> bool {
        let before = self.asked.fetch_add(1, Ordering::Relaxed);
        self.stops_after.is_some_and(|most| before >= most)
    }

    fn finished(&self, heads: &TrainedHeads) {
        let trials = heads.heads().iter().map(|head| head.trial().clone());
        self.finished.lock().unwrap().extend(trials);
        let diverged = heads.diverged().iter().cloned();
        self.diverged.lock().unwrap().extend(diverged);
    }
}

/// The network with all its parts, small.
pub(super) fn full() -> HeadConfig {
    HeadConfig {
        model: Model::CrossModal(CrossModal {
            latent: 6,
            hidden: 5,
            adversarial: Some(Adversarial {
                hidden: 7,
                ..Adversarial::default()
            }),
            classification: Some(Classification::new(LabelSource::VisuoTactileCluster {
                clusters: 4,
                components: 3,
                standardise_tactile: true,
            })),
            ..CrossModal::default()
        }),
        epochs: 3,
        batch_size: 7,
        ..HeadConfig::default()
    }
}

/// Mean and variance.
pub(super) fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count;
    let squares = values.map(|v| (v - mean).powi(2));
    (mean, squares.sum::<f64>() / count)
}

/// The cross-modal part of a configuration.
pub(super) fn cross_modal(config: &mut HeadConfig) -> &mut CrossModal {
    match &mut config.model {
        Model::CrossModal(model) => model,
        Model::Regression {} => panic!("not a cross-modal network"),
    }
}

/// All parameters.
pub(super) fn weights(head: &TrainedHead) -> Vec<f64> {
    let parameters = head.parameters.iter();
    let values = parameters.flat_map(|(_, tensor)| golden::values(tensor));
    values.collect()
}

/// The bits of all parameters and losses.
pub(super) fn bits(head: &TrainedHead) -> Vec<u64> {
    let history = head.history.iter().flat_map(EpochLosses::all);
    let all = weights(head).into_iter().chain(history);
    all.map(f64::to_bits).collect()
}
