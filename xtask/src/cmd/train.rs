use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use sps_dataset::{RandomSplit, Source, Split, SplitPlan};
use sps_metrics::{PredictionInterval, Samples, SplitConformal, TrainingMean, coverage};
use sps_models::heads::{Plan, Rerun, Trial, Views};

use crate::config::{Experiment, Looks, Method, Network, Setting};
use crate::data::{self, About, WithSource};
use crate::model::{self, Card};
use crate::run::{Fitted, Stage, Stages, Tables, fit, splits};

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
        let trainer = Trainer {
            experiment,
            method,
            source,
            stages: Stages::new(
                experiment,
                &method.encoder,
                source,
                &about,
                vec![data::nadir(source)?],
                None,
            )?,
        };
        trainer.print_check()?;
        let all: Vec<usize> = (0..source.surfaces().len()).collect();
        let model = trainer.calibrated(&all, 0)?;
        let frame = source.frame(0, model.stage.tables.views[0])?;
        let card = Card {
            format: 0,
            experiment: experiment.name.clone(),
            method: method.label.clone(),
            data: source.name().to_owned(),
            encoder: method.encoder.network.name().to_owned(),
            resize: method.encoder.resize,
            frame_size: [frame.height, frame.width],
            level: experiment.train.level.get(),
            radius: model.radius.clone(),
            checksums: BTreeMap::new(),
        };
        let encoder = model.stage.embedder.encoder().of_images()?;
        model::save(self.out, card, encoder, &model.fitted)?;
        println!("{}", self.out.display());
        Ok(())
    }
}

struct Trainer<'a, S> {
    experiment: &'a Experiment,
    method: &'a Method,
    source: &'a S,
    stages: Stages<'a, S>,
}

/// A fitted model with the half-width of each property's interval.
struct Calibrated {
    stage: Arc<Stage>,
    fitted: Fitted,
    radius: BTreeMap<String, f64>,
}

impl<S: Source> Trainer<'_, S> {
    /// Fits on part of `surfaces` and calibrates on the rest.
    fn calibrated(&self, surfaces: &[usize], number: u64) -> Result<Calibrated> {
        let split = self.calibration_split(surfaces, number)?;
        let stage = self.stages.of(&split.train)?;
        let tables = &stage.tables;
        let properties = tables.codes();
        let trials = properties.iter().map(|property| Trial {
            property: property.clone(),
            rerun: number,
            views: Views::Fixed(vec![0]),
        });
        let plan = Plan {
            seed: self.experiment.seed,
            reruns: vec![Rerun {
                number,
                training: split.train,
                validation: Vec::new(),
            }],
            trials: trials.collect(),
        };
        let fitted = fit(self.method, tables, &plan, &())?;
        let mut radius = BTreeMap::new();
        for estimates in fitted.predict(&tables.embeddings)? {
            let (property, values) = (&estimates.property, &estimates.values);
            let kept = Measured::of(tables, property, values, &split.validation)?;
            let conformal = SplitConformal::calibrate(kept.samples(), self.experiment.train.level)
                .with_context(|| format!("calibrating {}", estimates.property))?;
            radius.insert(estimates.property, conformal.radius());
        }
        Ok(Calibrated {
            stage,
            fitted,
            radius,
        })
    }

    /// Splits `surfaces` into a part to fit on and a part to calibrate with.
    fn calibration_split(&self, surfaces: &[usize], number: u64) -> Result<Split> {
        let chosen: Vec<_> = surfaces
            .iter()
            .map(|&s| self.source.surfaces()[s].clone())
            .collect();
        let plan = SplitPlan::Random(RandomSplit {
            validation: self.experiment.train.calibration,
            keep_groups: false,
        });
        let splits = plan.splits(&chosen, self.experiment.seed, number)?;
        let split = splits.into_iter().next().context("no split")?;
        let back = |part: Vec<usize>| part.into_iter().map(|i| surfaces[i]).collect();
        Ok(Split {
            train: back(split.train),
            validation: back(split.validation),
        })
    }

    /// Prints what such models do on the surfaces that each split of the config holds out.
    fn print_check(&self) -> Result<()> {
        let mut held_out: BTreeMap<String, HeldOut> = BTreeMap::new();
        let splits = splits(self.experiment, self.source.surfaces())?;
        for (number, split) in splits.iter().enumerate() {
            let model = self.calibrated(&split.train, number as u64)?;
            let tables = &model.stage.tables;
            for estimates in model.fitted.predict(&tables.embeddings)? {
                let (property, values) = (&estimates.property, &estimates.values);
                let training = Measured::of(tables, property, values, &split.train)?;
                let kept = Measured::of(tables, property, values, &split.validation)?;
                let mean = TrainingMean::of(&training.truth)?;
                let all = held_out.entry(property.clone()).or_default();
                all.r2
                    .push(kept.samples().r2(mean).map(|score| score.value));
                let radius = model.radius[property];
                all.intervals
                    .extend(kept.estimate.iter().map(|value| PredictionInterval {
                        low: value - radius,
                        high: value + radius,
                    }));
                all.truth.extend(kept.truth);
            }
        }
        println!(
            "{} on surfaces held out, {} splits:",
            self.method.label,
            splits.len()
        );
        println!("{:<6}{:>7}{:>14}{:>10}", "", "R²", "± interval", "covered");
        for (property, all) in &held_out {
            let r2 = sps_metrics::over_reruns(all.r2.iter().cloned());
            let coverage = coverage(&all.intervals, &all.truth)?;
            println!(
                "{property:<6}{:>7}{:>14.2}{:>9.1}%",
                r2.mean.map_or("–".to_owned(), |r2| format!("{r2:.3}")),
                coverage.mean_width / 2.0,
                100.0 * coverage.fraction()
            );
        }
        Ok(())
    }
}

/// Truths and estimates in the same order.
struct Measured {
    truth: Vec<f64>,
    estimate: Vec<f64>,
}

impl Measured {
    /// Truths and estimates of those of `surfaces` that were measured.
    fn of(tables: &Tables, property: &str, estimates: &[f64], surfaces: &[usize]) -> Result<Self> {
        let readings = &tables.readings;
        let column = readings
            .column(property)
            .context("a property that was not measured")?;
        let pairs = surfaces
            .iter()
            .filter_map(|&surface| Some((readings.get(surface, column)?, estimates[surface])));
        let (truth, estimate) = pairs.unzip();
        Ok(Self { truth, estimate })
    }

    fn samples(&self) -> Samples<'_> {
        Samples {
            truth: &self.truth,
            estimate: &self.estimate,
        }
    }
}

/// One property over all splits.
#[derive(Default)]
struct HeldOut {
    r2: Vec<Result<f64, sps_metrics::Undefined>>,
    intervals: Vec<PredictionInterval>,
    truth: Vec<f64>,
}
