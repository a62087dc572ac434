//! Fitting a model that is kept.

mod check;
mod scored;

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use sps_dataset::{Description, Frame, FrameFormat, Split, Unit};
use sps_estimator::{
    About, Calibration, Described, Estimator, Fitted, Measured, Predictions, Shown,
};
use tracing::warn;

use self::check::{Check, Found};
use self::scored::OfSplit;
use crate::config::{Experiment, Looks, Method, Network as NetworkSpec};
use crate::data;
use crate::encoder;
use crate::files::create_folder;
use crate::journal::Journal;
use crate::progress::ensure_wanted;
use crate::run::{
    Dealt, Encoded, Encodings, Folds, Selections, Splits, Stage, Stages, portion, views,
    what_is_measured,
};
use crate::text::counted;

/// Pixels of the shorter side, at most, of a photograph that is kept for people.
const SMALL: usize = 96;

/// What is known while a model is fitted, for people: called with lines of text as soon as they are
/// known.
pub type Say<'a> = &'a mut dyn FnMut(&str);

/// A model, and what models of its kind did on surfaces held out.
pub struct Trained {
    /// The model; what was measured is in its [`About`].
    pub model: Estimator,
    /// The surfaces whose estimates are furthest from what was measured, the worst first, and by how
    /// many standard deviations.
    pub worst: Vec<(String, f64)>,
}

/// Fits the method that the config's `train` names. Before that it says how well models of this kind do
/// on the splits of the config.
///
/// # Errors
/// A method that cannot be kept as a model; data or weights that cannot be read.
pub fn train(experiment: &Experiment, say: Say<'_>) -> Result<Trained> {
    let (source, about) = data::open(&experiment.data)?;
    let source = source.as_ref();
    let method = experiment.methods[experiment.fitted].on(source)?;
    ensure!(
        !matches!(method.encoder.network, NetworkSpec::Sequences { .. }),
        "method `{}` looks at a sequence by {}; a model that is kept looks at photographs",
        method.id,
        encoder::describe(&method.encoder)
    );
    keeps_its_views(&method)?;
    let splits = Splits::of(experiment, source.surfaces())?;
    let encoded = Encoded {
        experiment,
        source,
        about: &about,
        sequence: None,
        encoder: &method.encoder,
        methods: vec![&method],
        splits: &splits,
        dealt: Dealt::all(1, 0..1),
    };
    let trainer = Trainer {
        of: &encoded,
        method: &method,
        stages: Stages::new(&encoded)?,
    };
    let (measured, worst) = trainer.check(say)?;
    let all: Vec<usize> = (0..splits.pool).collect();
    let fit = trainer.fit(&all, 0)?;
    if splits.units.unit() != Unit::Surface {
        let calibrated = portion(&splits, std::slice::from_ref(&fit.part));
        say(&format!(
            "the intervals of the model are calibrated on {calibrated}"
        ));
    }
    if let Some(thinned) = method.estimator.thinned(fit.part.train.len()) {
        warn!("{thinned}");
    }
    if let Some(reason) = fit.fitted.no_familiar() {
        let what = "the model has no p-value of \"like what it was fitted on\"";
        say(&format!("{what}: {reason}"));
    }
    let about = trainer.about(&fit, measured)?;
    let view = fit.stage.tables.shown(&fit.photographs)[0];
    let model = Estimator::new(fit.stage.embedder.clone(), fit.fitted, about)?;
    let model = model.with_shown(|at| trainer.shown(at, view))?;
    Ok(Trained { model, worst })
}

/// Which method [`train`] fits, why, and how another is chosen.
pub fn which(experiment: &Experiment) -> String {
    let id = &experiment.methods[experiment.fitted].id;
    let kept = |method: &&Method| method.estimator.regression().is_some() && method.id != *id;
    let others = experiment.methods.iter().filter(kept);
    let others: Vec<&str> = others.map(|method| method.id.as_str()).collect();
    let why = if experiment.train.method.is_empty() {
        "the last of the config's methods"
    } else {
        "as `train.method` says"
    };
    let others = match others.join(", ") {
        none if none.is_empty() => none,
        some => format!("; `[train] method = \"ID\"` chooses another: {some}"),
    };
    format!("Fits method `{id}`, {why}{others}.")
}

/// Refuses a method whose views are not one photograph each, and the same for every surface.
fn keeps_its_views(method: &Method) -> Result<()> {
    let id = &method.id;
    match &method.looks {
        Looks::Nothing if method.estimator.file().is_some() => bail!(
            "method `{id}` has its estimates from a file, so there is nothing to fit and keep; \
            `[train] method = \"ID\"` chooses another"
        ),
        Looks::Nothing => {
            bail!("method `{id}` looks at no view; a model that is kept looks at some")
        }
        Looks::Relations(_) => bail!(
            "method `{id}` relates views that are drawn anew for each estimate; a model that is kept \
            looks at the same ones of every surface"
        ),
        Looks::Selected(_) if method.in_hindsight() => bail!(
            "method `{id}` chooses views by the surfaces held out; a model that is kept does not know \
            those that it will be asked about"
        ),
        Looks::Selected(selected) if selected.may_repeat() => bail!(
            "method `{id}` may look at a view twice; a model that is kept takes one photograph of \
            each: `distinct = true` chooses such views"
        ),
        Looks::Nadir | Looks::All | Looks::Selected(_) => Ok(()),
    }
}

struct Fit {
    stage: Arc<Stage>,
    fitted: Fitted,
    /// The views that photographs are taken of, in their order, as places in the tables.
    photographs: Vec<usize>,
    /// Surfaces that the regression learned from, and those that calibrate.
    part: Split,
}

struct Trainer<'a> {
    of: &'a Encoded<'a, 'a>,
    method: &'a Method,
    stages: Stages<'a>,
}

impl Trainer<'_> {
    /// Fits on some surfaces, a part of which calibrates the intervals: neither the regression, nor
    /// what chose the views, nor an encoder that is trained has seen its readings.
    fn fit(&self, surfaces: &[usize], number: u64) -> Result<Fit> {
        let (experiment, units) = (self.of.experiment, &self.of.splits.units);
        let calibration = Calibration {
            share: Some(experiment.train.calibration),
            level: experiment.train.level,
            seed: experiment.seed,
        };
        let part = calibration.part(units, surfaces, number);
        let part = part.context("[train]")?;
        let parts = self.of.splits.only(part.clone());
        let encodings = self.stages.of_splits(&parts.all, &[0].into())?.remove(0);
        let views = self.views(&encodings, &parts)?;
        let stage = encodings.stage;
        let tables = &stage.tables;
        let wanted = tables.properties.iter().zip(views);
        let recipe = tables.recipe(self.method, wanted, calibration)?;
        let learns = self.method.encoder.learns();
        let examples = tables.examples(units, if learns { &part.train } else { &[] });
        let fitted = recipe.fit(&examples, surfaces, number).context("[train]")?;
        let photographs = recipe.slots()?;
        Ok(Fit {
            stage,
            fitted,
            photographs,
            part,
        })
    }

    /// The views that each property is estimated from, as places in the tables: a selector that learns
    /// does so on the one training part of `parts`.
    fn views(&self, encodings: &Encodings, parts: &Splits) -> Result<Vec<Vec<usize>>> {
        let (experiment, tables) = (self.of.experiment, &encodings.stage.tables);
        // Embeddings from a file leave no cache behind.
        create_folder(&experiment.cache)?;
        let mut journal = Journal::open(&experiment.cache.join("selections.jsonl"))?;
        let mut selections = Selections::default();
        let folds = Folds {
            experiment,
            encodings,
            splits: parts,
        };
        let dealt = &self.of.dealt;
        folds.select(&[self.method], dealt, &mut journal, &mut selections)?;
        let of_property = |property| {
            let trial = (property, 0, &parts.all[0]);
            let views = views::of_trial(experiment, self.method, tables, trial, &selections)?;
            Ok(views.shown())
        };
        tables.properties.iter().map(of_property).collect()
    }

    fn shown(&self, surface: usize, view: usize) -> Result<Shown> {
        let mut photograph = Vec::new();
        if self.of.experiment.train.keep_photographs {
            let frame = self.of.source.frame(surface, view)?;
            let side = frame.width.min(frame.height).min(SMALL);
            photograph = FrameFormat::Png.encode(&*frame.resized(side)?)?;
        }
        Ok(Shown {
            name: self.of.source.surfaces()[surface].id.clone(),
            photograph,
        })
    }

    fn about(&self, fit: &Fit, measured: BTreeMap<String, Measured>) -> Result<About> {
        let (experiment, source) = (self.of.experiment, self.of.source);
        let views = fit.stage.tables.shown(&fit.photographs);
        let frame = source.frame(0, views[0])?;
        self.warn_of_sizes(&frame, views[0])?;
        let angles = source.view_angles();
        let described = fit.stage.tables.properties.iter().map(|property| {
            let Description { name, unit, .. } = source.describe(property);
            (property.to_string(), Described { name, unit })
        });
        Ok(About {
            name: experiment.name.clone(),
            method: self.method.label.clone(),
            data: source.name().to_owned(),
            source: self.of.about.origin.clone(),
            frame_size: [frame.height, frame.width],
            angles: views.iter().map(|&view| angles[view].0).collect(),
            decode: self.of.about.decode.clone(),
            described: described.collect(),
            measured,
        })
    }

    /// Photographs are brought to the size of one frame: where the frames differ and are not brought to
    /// one size, that is not how the model saw them.
    fn warn_of_sizes(&self, first: &Frame, view: usize) -> Result<()> {
        const SOME: usize = 16;
        let encoder = &self.method.encoder;
        if encoder.resize.is_some() || encoder.network.kind().is_none() {
            return Ok(());
        }
        for surface in 1..self.of.source.surfaces().len().min(SOME) {
            let frame = self.of.source.frame(surface, view)?;
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

    /// Says what such models do on the surfaces that each split of the config holds out.
    fn check(&self, say: Say<'_>) -> Result<Found> {
        let (splits, source) = (&self.of.splits.all, self.of.source);
        let unit = self.of.splits.units.unit();
        let mut check = Check::new(unit, self.method.adaptive);
        for (number, split) in splits.iter().enumerate() {
            ensure_wanted()?;
            let fit = self.fit(&split.train, number as u64)?;
            let (predictions, joint) = self.predictions(&fit, &split.validation)?;
            let of_split = OfSplit {
                tables: &fit.stage.tables,
                split,
                units: &self.of.splits.units,
            };
            check.add(of_split, &fit.fitted, predictions)?;
            check.add_joint(of_split, &joint);
        }
        let held_out: usize = splits.iter().map(|split| split.validation.len()).sum();
        let of_split = held_out / splits.len().max(1);
        let times = match splits.len() {
            1 => String::new(),
            several => format!(" in each of {several} splits"),
        };
        let train = &self.of.experiment.train;
        say(&format!(
            "{} on {unit} held out, {}{times}, intervals of {:.0} %:",
            self.method.label,
            counted(of_split, "surface"),
            100.0 * train.level.get()
        ));
        say(&what_is_measured(self.of.splits, source.surfaces()));
        let found = check.print(source.surfaces(), say)?;
        say(&format!(
            "values are estimated by a model of all surfaces fitted to; intervals by one that has not seen \
            the {:.0} % that calibrate them",
            100.0 * train.calibration
        ));
        Ok(found)
    }

    /// What is predicted of surfaces from each number of views that the model takes, and of all properties
    /// at once from all views.
    fn predictions(
        &self,
        fit: &Fit,
        surfaces: &[usize],
    ) -> Result<(BTreeMap<usize, Predictions>, Predictions)> {
        let places = &fit.photographs;
        let mut encodings = Encodings::new(Arc::clone(&fit.stage), 0..0);
        encodings.look_at(self.of, places.iter().copied())?;
        let step = |views: usize| {
            let embeddings = encodings.select(surfaces, &places[..views])?;
            Ok((views, fit.fitted.predict(&embeddings)?))
        };
        let all = encodings.select(surfaces, places)?;
        let joint = fit.fitted.predict_jointly(&all)?;
        Ok((fit.fitted.steps().map(step).collect::<Result<_>>()?, joint))
    }
}
