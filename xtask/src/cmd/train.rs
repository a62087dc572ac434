use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use sps_dataset::Source;
use sps_metrics::{PredictionInterval, TrainingMean, coverage};
use sps_models::heads::{Estimates, Plan, Rerun, Trial, Views};

use crate::config::{Experiment, Looks, Method, Network, Setting};
use crate::data::{self, About, WithSource};
use crate::model::{self, Card};
use crate::run::{Encodings, Fitted, Splits, Stages, Tables, conformal, fit};

/// Fit a model that `predict` can use
#[derive(clap::Args)]
#[command(
    after_help = "Prints how well models of this kind do on the splits of the config, then fits \
    the one to keep on all surfaces but those that calibrate its intervals.\n\nExample:\n  \
    cargo xtask train configs/friction-photos.toml --out models/friction"
)]
pub(crate) struct Args {
    /// An experiment's TOML file; its `train` says which method, and how intervals are calibrated
    config: PathBuf,
    /// Override a key of the config; VALUE is TOML, or else a text
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<Setting>,
    /// The folder to write the model to
    #[arg(long, value_name = "MODEL_DIR")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let experiment = Experiment::read(&args.config, &args.settings)?;
    let out = &args.out;
    data::with_source(
        &experiment.data,
        Train {
            experiment: &experiment,
            out,
        },
    )
}

struct Train<'a> {
    experiment: &'a Experiment,
    out: &'a Path,
}

impl WithSource for Train<'_> {
    type Output = ();

    fn call<S: Source>(self, source: &S, about: About) -> Result<()> {
        let experiment = self.experiment;
        let method = &experiment.methods[experiment.train.method];
        ensure!(
            method.looks == Looks::Nadir,
            "method `{}` looks at several views; a model that is kept looks at the one straight down",
            method.id
        );
        ensure!(
            matches!(method.encoder.network, Network::Images(_)),
            "method `{}` looks at a sequence by {}; a model that is kept looks at one photograph",
            method.id,
            method.encoder.network.name()
        );
        let splits = Splits::of(experiment, source.surfaces())?;
        let views = vec![data::nadir(source)?];
        let data = (source, &about);
        let trainer = Trainer {
            experiment,
            method,
            source,
            splits: &splits,
            stages: Stages::new(experiment, &method.encoder, data, &splits, views, None)?,
        };
        trainer.print_check()?;
        let all: Vec<usize> = (0..splits.pool).collect();
        let model = trainer.calibrated(&all, 0)?;
        let stage = &model.encodings.stage;
        let frame = source.frame(0, stage.tables.views[0])?;
        let card = Card {
            format: 0,
            experiment: experiment.name.clone(),
            method: method.label.clone(),
            data: source.name().to_owned(),
            encoder: method.encoder.network.name().to_owned(),
            precision: method.precision(),
            resize: method.encoder.resize,
            frame_size: [frame.height, frame.width],
            level: experiment.train.level.get(),
            radius: model.radius.clone(),
            no_interval: model.no_interval.clone(),
            checksums: BTreeMap::new(),
        };
        let encoder = stage.embedder.encoder().of_images()?;
        model::save(self.out, card, encoder, &model.fitted)?;
        println!("{}", self.out.display());
        Ok(())
    }
}

struct Trainer<'a, S> {
    experiment: &'a Experiment,
    method: &'a Method,
    source: &'a S,
    splits: &'a Splits,
    stages: Stages<'a, S>,
}

/// A fitted model with the half-width of each property's interval.
struct Calibrated {
    encodings: Encodings,
    fitted: Fitted,
    radius: BTreeMap<String, f64>,
    /// Why a property has none.
    no_interval: BTreeMap<String, String>,
}

impl Calibrated {
    /// The property and the estimate for each of `surfaces`.
    fn estimates(&self, surfaces: &[usize]) -> Result<Vec<Estimates>> {
        Ok(self
            .fitted
            .models()
            .predict(&self.encodings.select(surfaces, &[0])?)?)
    }
}

impl<S: Source> Trainer<'_, S> {
    /// Fits on part of `surfaces` and calibrates on the rest; units stay whole.
    fn calibrated(&self, surfaces: &[usize], number: u64) -> Result<Calibrated> {
        let (experiment, units) = (self.experiment, &self.splits.units);
        let (seed, train) = (experiment.seed, &experiment.train);
        let splits = self.splits;
        let split = splits.kept_aside(surfaces, train.calibration, seed, number);
        let split = split.context("train.calibration")?;
        let stage = self.stages.of(&split.train)?;
        let plan = self.plan(&stage.tables, &split.train, number);
        let fitted = fit(self.method, (&stage.tables, units), &plan, &())?;
        let beyond = self.source.surfaces().len() - self.splits.pool;
        let encodings = Encodings::with_test_views(experiment, self.source, stage, &[0], beyond)?;
        let mut calibrated = Calibrated {
            encodings,
            fitted,
            radius: BTreeMap::new(),
            no_interval: BTreeMap::new(),
        };
        let tables = &calibrated.encodings.stage.tables;
        for estimates in calibrated.estimates(&split.validation)? {
            let kept = Measured::of(tables, &estimates, &split.validation)?;
            match conformal::radius(units, &kept.residuals(), train.level) {
                Ok(radius) => drop(calibrated.radius.insert(estimates.property, radius)),
                Err(reason) => {
                    let reason = reason.to_string();
                    calibrated.no_interval.insert(estimates.property, reason);
                }
            }
        }
        Ok(calibrated)
    }

    /// A trial for each property on the view straight down.
    fn plan(&self, tables: &Tables, training: &[usize], number: u64) -> Plan {
        let trials = tables.codes().into_iter().map(|property| Trial {
            property,
            rerun: number,
            views: Views::Fixed(vec![0]),
        });
        Plan {
            seed: self.experiment.seed,
            reruns: vec![Rerun {
                number,
                training: training.to_vec(),
                validation: Vec::new(),
            }],
            trials: trials.collect(),
        }
    }

    /// Prints what such models do on the surfaces that each split of the config holds out.
    fn print_check(&self) -> Result<()> {
        let splits = &self.splits.all;
        let mut held_out: BTreeMap<String, HeldOut> = BTreeMap::new();
        for (number, split) in splits.iter().enumerate() {
            let model = self.calibrated(&split.train, number as u64)?;
            let tables = &model.encodings.stage.tables;
            for estimates in model.estimates(&split.validation)? {
                let kept = Measured::of(tables, &estimates, &split.validation)?;
                let mean = training_mean(tables, &estimates.property, &split.train)?;
                let all = held_out.entry(estimates.property.clone()).or_default();
                all.add(&kept, mean, &model, &estimates.property);
            }
        }
        println!(
            "{} on {} held out, {} splits:",
            self.method.label,
            self.splits.units.unit(),
            splits.len()
        );
        println!("{:<6}{:>7}{:>14}{:>10}", "", "R²", "± interval", "covered");
        for (property, all) in &held_out {
            println!("{property:<6}{:>7}{}", all.r2(), all.coverage()?);
        }
        for (property, all) in &held_out {
            if let Some(reason) = &all.no_interval {
                println!("{property}: no interval, {reason}");
            }
        }
        Ok(())
    }
}

/// The mean of what was measured of the training surfaces.
fn training_mean(tables: &Tables, property: &str, training: &[usize]) -> Result<TrainingMean> {
    let column = tables.readings.column(property).context(NOT_MEASURED)?;
    let reading = |&surface: &usize| tables.readings.get(surface, column);
    let readings: Vec<f64> = training.iter().filter_map(reading).collect();
    Ok(TrainingMean::of(&readings)?)
}

const NOT_MEASURED: &str = "a property that was not measured";

/// Surfaces with truths and estimates, in the same order.
struct Measured {
    surfaces: Vec<usize>,
    truth: Vec<f64>,
    estimate: Vec<f64>,
}

impl Measured {
    /// Those of `surfaces` that were measured; there is an estimate for each of all.
    fn of(tables: &Tables, estimates: &Estimates, surfaces: &[usize]) -> Result<Self> {
        let readings = &tables.readings;
        let column = readings.column(&estimates.property).context(NOT_MEASURED)?;
        let mut measured = Self {
            surfaces: Vec::new(),
            truth: Vec::new(),
            estimate: Vec::new(),
        };
        for (&surface, &estimate) in surfaces.iter().zip(&estimates.values) {
            if let Some(truth) = readings.get(surface, column) {
                measured.surfaces.push(surface);
                measured.truth.push(truth);
                measured.estimate.push(estimate);
            }
        }
        Ok(measured)
    }

    fn residuals(&self) -> Vec<(usize, f64)> {
        let pairs = self.truth.iter().zip(&self.estimate);
        let residuals = pairs.map(|(truth, estimate)| truth - estimate);
        self.surfaces.iter().copied().zip(residuals).collect()
    }
}

/// One property over all splits.
#[derive(Default)]
struct HeldOut {
    /// Squared errors, and squared distances from the training mean, all splits together.
    errors: f64,
    distances: f64,
    intervals: Vec<PredictionInterval>,
    /// Of the splits that have intervals.
    truth: Vec<f64>,
    no_interval: Option<String>,
}

impl HeldOut {
    fn add(&mut self, kept: &Measured, mean: TrainingMean, model: &Calibrated, property: &str) {
        for (truth, estimate) in kept.truth.iter().zip(&kept.estimate) {
            self.errors += (truth - estimate).powi(2);
            self.distances += (truth - mean.get()).powi(2);
        }
        let Some(&radius) = model.radius.get(property) else {
            self.no_interval = model.no_interval.get(property).cloned();
            return;
        };
        let around = |value: &f64| PredictionInterval {
            low: value - radius,
            high: value + radius,
        };
        self.intervals.extend(kept.estimate.iter().map(around));
        self.truth.extend(&kept.truth);
    }

    /// About the training mean of each split.
    fn r2(&self) -> String {
        if self.distances > 0.0 {
            format!("{:.3}", 1.0 - self.errors / self.distances)
        } else {
            "–".to_owned()
        }
    }

    fn coverage(&self) -> Result<String> {
        if self.intervals.is_empty() {
            return Ok(format!("{:>14}{:>10}", "–", "–"));
        }
        let coverage = coverage(&self.intervals, &self.truth)?;
        let (half, share) = (coverage.mean_width / 2.0, 100.0 * coverage.fraction());
        Ok(format!("{half:>14.2}{share:>9.1}%"))
    }
}
