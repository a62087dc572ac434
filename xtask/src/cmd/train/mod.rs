mod check;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use sps_dataset::{DecodeSettings, Frame, Source};
use sps_estimator::{
    About, Calibration, Estimator, Examples, Fitted, Measured, Predictions, Recipe, Wanted, Widths,
};
use tracing::warn;

use self::check::Check;
use crate::config::{
    DataSpec, Experiment, Looks, Method, Network as NetworkSpec, Setting, in_order,
};
use crate::data::{self, About as AboutData, WithSource};
use crate::run::{Encodings, Splits, Stage, Stages, Tables, views};

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

    fn call<S: Source>(self, source: &S, about: AboutData) -> Result<()> {
        let experiment = self.experiment;
        let method = experiment.methods[experiment.train.method].on(source.view_angles().len())?;
        ensure!(
            matches!(method.encoder.network, NetworkSpec::Images(_)),
            "method `{}` looks at a sequence by {}; a model that is kept looks at photographs",
            method.id,
            method.encoder.network.name()
        );
        let looked_at = looked_at(experiment, &method, source)?;
        let splits = Splits::of(experiment, source.surfaces())?;
        let data = (source, &about);
        let mut all_views = looked_at.clone();
        all_views.sort_unstable();
        let stages = Stages::new(experiment, &method.encoder, data, &splits, all_views, None)?;
        let trainer = Trainer {
            experiment,
            method: &method,
            looked_at,
            source,
            origin: &about.origin,
            splits: &splits,
            stages,
        };
        let measured = trainer.check()?;
        let all: Vec<usize> = (0..splits.pool).collect();
        let (stage, fitted) = trainer.fit(&all, 0)?;
        let about = trainer.about(measured)?;
        let estimator = Estimator::new(stage.embedder.clone(), fitted, about)?;
        let file = |error| anyhow::Error::from(error).context(self.out.display().to_string());
        estimator.save(self.out).map_err(file)?;
        println!("{}", self.out.display());
        Ok(())
    }
}

/// The views that the method looks at, in the order in which photographs are given, as indices of the
/// source.
fn looked_at<S: Source>(
    experiment: &Experiment,
    method: &Method,
    source: &S,
) -> Result<Vec<usize>> {
    let count = source.view_angles().len();
    let views = match &method.looks {
        Looks::Nadir => vec![data::nadir(source)?],
        Looks::All => (0..count).collect(),
        Looks::Selected(selected) if !selected.learns() => {
            let picks = views::without_loss(selected, count, experiment.seed)?.picks;
            match method.adaptive {
                Some(_) => in_order(&selected.selector, picks),
                None => picks,
            }
        }
        Looks::Selected(_) | Looks::Relations(_) | Looks::Nothing => bail!(
            "method `{}` has no fixed views; a model that is kept looks at the same ones of every surface",
            method.id
        ),
    };
    let twice = (1..views.len()).find(|&at| views[..at].contains(&views[at]));
    if let Some(at) = twice {
        bail!(
            "method `{}` looks at view {} twice; a model that is kept takes one photograph of each: \
            `distinct = true` chooses such views",
            method.id,
            views[at]
        );
    }
    Ok(views)
}

struct Trainer<'a, S> {
    experiment: &'a Experiment,
    method: &'a Method,
    looked_at: Vec<usize>,
    source: &'a S,
    /// Where the data comes from and under which licence.
    origin: &'a str,
    splits: &'a Splits,
    stages: Stages<'a, S>,
}

impl<S: Source> Trainer<'_, S> {
    /// Fits on some surfaces, a part of which calibrates the intervals: neither the regression nor an
    /// encoder that is trained has seen its readings.
    fn fit(&self, surfaces: &[usize], number: u64) -> Result<(Arc<Stage>, Fitted)> {
        let (experiment, units) = (self.experiment, &self.splits.units);
        let calibration = Calibration {
            share: experiment.train.calibration,
            level: experiment.train.level,
            seed: experiment.seed,
        };
        let part = calibration
            .part(units, surfaces, number)
            .context("[train]")?;
        let stage = self.stages.of(&part.train)?;
        let tables = &stage.tables;
        let places = self.places(tables)?;
        let ranges = self.source.ranges();
        let wanted = tables.properties.iter().map(|property| Wanted {
            property: property.to_string(),
            views: places.clone(),
            range: ranges.get(*property),
        });
        let regression = self.method.estimator.regression();
        let recipe = Recipe {
            regression: regression.context("a mean is not kept")?.clone(),
            wanted: wanted.collect(),
            one_by_one: self.method.adaptive.is_some(),
            widths: Widths::ByPhotograph,
            calibration,
        };
        let examples = Examples {
            data: tables.training_data(units),
            units,
        };
        let fitted = recipe.fit(&examples, surfaces, number).context("[train]")?;
        Ok((stage, fitted))
    }

    /// Where the views that are looked at stand in the tables.
    fn places(&self, tables: &Tables) -> Result<Vec<usize>> {
        let places = self.looked_at.iter().map(|&view| tables.place(view));
        places.collect()
    }

    fn about(&self, measured: BTreeMap<String, Measured>) -> Result<About> {
        let (experiment, source) = (self.experiment, self.source);
        let frame = source.frame(0, self.looked_at[0])?;
        self.warn_of_sizes(&frame)?;
        let angles = source.view_angles();
        let decode = match &experiment.data {
            DataSpec::Folder { read, .. } => read.images.clone(),
            DataSpec::Simulated { .. } => DecodeSettings::default(),
        };
        Ok(About {
            name: experiment.name.clone(),
            method: self.method.label.clone(),
            data: source.name().to_owned(),
            source: self.origin.to_owned(),
            frame_size: [frame.height, frame.width],
            angles: self.looked_at.iter().map(|&view| angles[view].0).collect(),
            decode,
            measured,
        })
    }

    /// Photographs are brought to the size of one frame: where the frames differ and are not brought to
    /// one size, that is not how the model saw them.
    fn warn_of_sizes(&self, first: &Frame) -> Result<()> {
        const SOME: usize = 16;
        if self.method.encoder.resize.is_some() {
            return Ok(());
        }
        for surface in 1..self.source.surfaces().len().min(SOME) {
            let frame = self.source.frame(surface, self.looked_at[0])?;
            if frame.extent() != first.extent() {
                warn!(
                    "frames differ in size; photographs are brought to that of the first, {} x {} \
                    pixels: `encoder.resize` brings frames and photographs to one size",
                    first.width, first.height
                );
                break;
            }
        }
        Ok(())
    }

    /// Prints what such models do on the surfaces that each split of the config holds out.
    fn check(&self) -> Result<BTreeMap<String, Measured>> {
        let splits = &self.splits.all;
        let mut check = Check::new(self.method.adaptive);
        for (number, split) in splits.iter().enumerate() {
            let (stage, fitted) = self.fit(&split.train, number as u64)?;
            let predictions = self.predictions(&stage, &fitted, &split.validation)?;
            check.add((&stage.tables, split), &fitted, predictions)?;
        }
        println!(
            "{} on {} held out, {} splits:",
            self.method.label,
            self.splits.units.unit(),
            splits.len()
        );
        check.print()
    }

    /// What is predicted of surfaces from each number of views that the model takes.
    fn predictions(
        &self,
        stage: &Arc<Stage>,
        fitted: &Fitted,
        surfaces: &[usize],
    ) -> Result<BTreeMap<usize, Predictions>> {
        let (experiment, source) = (self.experiment, self.source);
        let places = self.places(&stage.tables)?;
        let beyond = source.surfaces().len() - self.splits.pool;
        let stage = Arc::clone(stage);
        let encodings = Encodings::with_test_views(experiment, source, stage, &places, beyond)?;
        let step = |views: usize| {
            let embeddings = encodings.select(surfaces, &places[..views])?;
            Ok((views, fitted.predict(&embeddings)?))
        };
        fitted.steps().map(step).collect()
    }
}
