use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use sps_dataset::{DecodeSettings, Source, Split};
use sps_estimator::{
    About, Estimator, Examples, Fitted, Measured, Network, Predicted, Predictions, Recipe, Wanted,
    Widths,
};
use sps_metrics::{Moments, PredictionInterval, coverage};

use crate::config::{DataSpec, Experiment, Looks, Method, Setting, in_order};
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
    match &method.looks {
        Looks::Nadir => Ok(vec![data::nadir(source)?]),
        Looks::All => Ok((0..count).collect()),
        Looks::Selected(selected) if !selected.learns() => {
            let picks = views::without_loss(selected, count, experiment.seed)?.picks;
            Ok(match method.adaptive {
                Some(_) => in_order(&selected.selector, picks),
                None => picks,
            })
        }
        Looks::Selected(_) | Looks::Relations(_) | Looks::Nothing => anyhow::bail!(
            "method `{}` has no fixed views; a model that is kept looks at the same ones of every surface",
            method.id
        ),
    }
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
    /// Fits on some surfaces, a part of which calibrates the intervals.
    fn fit(&self, surfaces: &[usize], number: u64) -> Result<(Arc<Stage>, Fitted)> {
        let stage = self.stages.of(surfaces)?;
        ensure!(
            matches!(stage.embedder.network(), Network::Images(_)),
            "method `{}` looks at a sequence by {}; a model that is kept looks at photographs",
            self.method.id,
            stage.embedder.network().name()
        );
        let (experiment, tables) = (self.experiment, &stage.tables);
        let places = self.looked_at.iter().map(|&view| tables.place(view));
        let places = places.collect::<Result<Vec<usize>>>()?;
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
            calibration: experiment.train.calibration,
            level: experiment.train.level,
            seed: experiment.seed,
        };
        let units = &self.splits.units;
        let examples = Examples {
            data: tables.training_data(units),
            units,
        };
        let fitted = recipe.fit(&examples, surfaces, number).context("[train]")?;
        Ok((stage, fitted))
    }

    fn about(&self, measured: BTreeMap<String, Measured>) -> Result<About> {
        let (experiment, source) = (self.experiment, self.source);
        let frame = source.frame(0, self.looked_at[0])?;
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

    /// Prints what such models do on the surfaces that each split of the config holds out.
    fn check(&self) -> Result<BTreeMap<String, Measured>> {
        let splits = &self.splits.all;
        let mut rows: BTreeMap<Row, HeldOuts> = BTreeMap::new();
        let mut views_taken = Vec::new();
        let mut familiar = Vec::new();
        for (number, split) in splits.iter().enumerate() {
            let (stage, fitted) = self.fit(&split.train, number as u64)?;
            let all = self.predictions(&stage, &fitted, &split.validation)?;
            let tables = &stage.tables;
            for (views, predictions) in &all {
                let row = rows.entry(Row::Views(*views)).or_default();
                row.add(tables, split, predictions)?;
            }
            if let Some(adaptive) = &self.method.adaptive {
                let (views, stopped) = stopped(&fitted, &all, adaptive.width);
                views_taken.extend(views);
                rows.entry(Row::Session)
                    .or_default()
                    .add(tables, split, &stopped)?;
            }
            let last = all.into_iter().next_back();
            familiar.extend(
                last.and_then(|(_, predictions)| predictions.familiar)
                    .unwrap_or_default(),
            );
        }
        println!(
            "{} on {} held out, {} splits:",
            self.method.label,
            self.splits.units.unit(),
            splits.len()
        );
        let last = rows.iter().rfind(|(row, _)| **row != Row::Session);
        let measured = last.map(|(_, held_out)| held_out.print()).transpose()?;
        if !familiar.is_empty() {
            let unlike = familiar.iter().filter(|p| **p <= UNFAMILIAR).count() as f64;
            let share = 100.0 * unlike / familiar.len() as f64;
            println!(
                "{share:.1} % of them are unlike what was fitted on (p <= {UNFAMILIAR}; where nothing is new, at most 5 %)"
            );
        }
        if self.method.adaptive.is_some() {
            println!("\nViews one by one, means over the properties:");
            println!(
                "{:<24}{:>7}{:>14}{:>10}",
                "", "R²", "± deviations", "covered"
            );
            let mean = views_taken.iter().sum::<usize>() as f64 / views_taken.len().max(1) as f64;
            for (row, held_out) in &rows {
                let name = match row {
                    Row::Views(1) => "1 view".to_owned(),
                    Row::Views(views) => format!("{views} views"),
                    Row::Session => format!("until sure, {mean:.2} views"),
                };
                println!("{name:<24}{}", held_out.means()?);
            }
        }
        Ok(measured.unwrap_or_default())
    }

    /// What is predicted of surfaces from each number of views that the model takes.
    fn predictions(
        &self,
        stage: &Arc<Stage>,
        fitted: &Fitted,
        surfaces: &[usize],
    ) -> Result<BTreeMap<usize, Predictions>> {
        let (experiment, source) = (self.experiment, self.source);
        let places = self.looked_at.iter().map(|&view| stage.tables.place(view));
        let places = places.collect::<Result<Vec<usize>>>()?;
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

/// Photographs are counted as unlike what a model was fitted on below this p-value.
const UNFAMILIAR: f64 = 0.05;

/// How many views are looked at.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Row {
    Views(usize),
    /// As many as it takes.
    Session,
}

/// What sessions say of surfaces that stop at the first number of views after which all intervals are
/// narrow, and that number for each surface.
fn stopped(
    fitted: &Fitted,
    all: &BTreeMap<usize, Predictions>,
    width: f64,
) -> (Vec<usize>, Predictions) {
    let mut steps = all.iter().rev();
    let Some((&most, last)) = steps.next() else {
        return (
            Vec::new(),
            Predictions {
                properties: Vec::new(),
                familiar: None,
            },
        );
    };
    let mut stopped = last.clone();
    let surfaces = stopped
        .properties
        .first()
        .map_or(0, |predicted| predicted.values.len());
    let mut views = vec![most; surfaces];
    for (&step, predictions) in steps {
        let narrow = fitted.narrow(predictions, width);
        for surface in (0..surfaces).filter(|&at| narrow.iter().all(|narrow| narrow[at])) {
            views[surface] = step;
            for (to, from) in stopped.properties.iter_mut().zip(&predictions.properties) {
                to.values[surface] = from.values[surface];
                if let (Ok(to), Ok(from)) = (&mut to.intervals, &from.intervals) {
                    to[surface] = from[surface];
                }
            }
        }
    }
    (views, stopped)
}

/// All properties over all splits.
#[derive(Default)]
struct HeldOuts(BTreeMap<String, HeldOut>);

impl HeldOuts {
    fn add(&mut self, tables: &Tables, split: &Split, predictions: &Predictions) -> Result<()> {
        for predicted in &predictions.properties {
            let training = training(tables, &predicted.property, &split.train)?;
            let all = self.0.entry(predicted.property.clone()).or_default();
            all.add(tables, &split.validation, &training, predicted)?;
        }
        Ok(())
    }

    /// Prints a line for each property, and gives what it says.
    fn print(&self) -> Result<BTreeMap<String, Measured>> {
        println!("{:<6}{:>7}{:>14}{:>10}", "", "R²", "± interval", "covered");
        let mut measured = BTreeMap::new();
        for (property, all) in &self.0 {
            let of_property = all.measured()?;
            println!("{property:<6}{}", shown(&of_property));
            measured.insert(property.clone(), of_property);
        }
        for (property, all) in &self.0 {
            if let Some(reason) = &all.no_interval {
                println!("{property}: no interval, {reason}");
            }
        }
        Ok(measured)
    }

    /// The means over the properties; widths in standard deviations of the training readings.
    fn means(&self) -> Result<String> {
        let all = self
            .0
            .values()
            .map(|of| Ok((of.measured()?, of.deviation())));
        let all = all.collect::<Result<Vec<(Measured, f64)>>>()?;
        let mean = |of: &dyn Fn(&(Measured, f64)) -> Option<f64>| {
            let values: Option<Vec<f64>> = all.iter().map(of).collect();
            values.map(|values| values.iter().sum::<f64>() / values.len().max(1) as f64)
        };
        Ok(shown(&Measured {
            readings: all.iter().map(|(measured, _)| measured.readings).sum(),
            r2: mean(&|(measured, _)| measured.r2),
            coverage: mean(&|(measured, _)| measured.coverage),
            mean_width: mean(&|(measured, deviation)| Some(measured.mean_width? / deviation)),
        }))
    }
}

fn shown(measured: &Measured) -> String {
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
    let r2 = or_dash(measured.r2.map(|r2| format!("{r2:.3}")));
    let half = or_dash(
        measured
            .mean_width
            .map(|width| format!("{:.2}", width / 2.0)),
    );
    let share = or_dash(
        measured
            .coverage
            .map(|share| format!("{:.1}%", 100.0 * share)),
    );
    format!("{r2:>7}{half:>14}{share:>10}")
}

/// What was measured of the training surfaces.
fn training(tables: &Tables, property: &str, training: &[usize]) -> Result<Moments> {
    let column = tables.readings.column(property).context(NOT_MEASURED)?;
    let mut moments = Moments::new();
    for reading in training
        .iter()
        .filter_map(|&surface| tables.readings.get(surface, column))
    {
        moments.push(reading);
    }
    Ok(moments)
}

const NOT_MEASURED: &str = "a property that was not measured";

/// One property over all splits.
#[derive(Default)]
struct HeldOut {
    readings: usize,
    /// Squared errors, and squared distances from the training mean, all splits together.
    errors: f64,
    distances: f64,
    intervals: Vec<PredictionInterval>,
    /// Of the splits that have intervals.
    truth: Vec<f64>,
    no_interval: Option<String>,
    /// Standard deviations of the training readings, one of each split.
    deviations: Vec<f64>,
}

impl HeldOut {
    /// Adds what was predicted of some surfaces, as far as they were measured.
    fn add(
        &mut self,
        tables: &Tables,
        surfaces: &[usize],
        training: &Moments,
        predicted: &Predicted,
    ) -> Result<()> {
        let mean = training.mean()?;
        self.deviations
            .push(training.sample_std().unwrap_or_default());
        let column = tables.readings.column(&predicted.property);
        let column = column.context(NOT_MEASURED)?;
        let truths: Vec<Option<f64>> = surfaces
            .iter()
            .map(|&surface| tables.readings.get(surface, column))
            .collect();
        for (truth, estimate) in truths.iter().zip(&predicted.values) {
            if let Some(truth) = truth {
                self.readings += 1;
                self.errors += (truth - estimate).powi(2);
                self.distances += (truth - mean).powi(2);
            }
        }
        match &predicted.intervals {
            Err(reason) => self.no_interval = Some(reason.clone()),
            Ok(intervals) => {
                let read = truths.into_iter().zip(intervals);
                let read = read.filter_map(|(truth, interval)| Some((truth?, *interval)));
                let (truth, intervals): (Vec<f64>, Vec<_>) = read.unzip();
                self.truth.extend(truth);
                self.intervals.extend(intervals);
            }
        }
        Ok(())
    }

    fn deviation(&self) -> f64 {
        self.deviations.iter().sum::<f64>() / self.deviations.len().max(1) as f64
    }

    fn measured(&self) -> Result<Measured> {
        let any = !self.intervals.is_empty();
        let coverage = any.then(|| coverage(&self.intervals, &self.truth));
        let coverage = coverage.transpose()?;
        Ok(Measured {
            readings: self.readings,
            r2: (self.distances > 0.0).then(|| 1.0 - self.errors / self.distances),
            coverage: coverage.map(|coverage| coverage.fraction()),
            mean_width: coverage.map(|coverage| coverage.mean_width),
        })
    }
}
