//! Running an experiment: embed, fit what is missing, score, report.

mod adaptive;
pub(crate) mod conformal;
mod costs;
mod encodings;
mod fit;
mod floors;
mod folder;
mod provenance;
mod refit;
mod select;
mod selection;
mod splits;
mod stage;
mod tables;
mod test_views;
mod trials;
mod views;

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use rayon::prelude::*;
use sps_dataset::Source;

use costs::Asked;
pub(crate) use encodings::Encodings;
pub(crate) use fit::{Fitted, fit};
pub(crate) use folder::seal;
pub(crate) use splits::Splits;
use stage::Stage;
pub(crate) use stage::Stages;
pub(crate) use tables::Tables;

use crate::config::{EncoderSpec, Experiment, Looks, Method, Network};
use crate::data::{self, About, WithSource};
use crate::encoder;
use crate::journal::{Journal, Outcome, Stop};
use crate::report::{self, paper, predictions};
use crate::results::{
    Costs, Dataset, Judged, MethodOutcomes, MethodResult, PerProperty, Provenance, Results,
    Scoring, Speed, score,
};
use crate::sequences::Sequences;
use folder::RunFolder;
use select::{Found, Selecting, Selections};
use trials::{Planned, TrialSpec};

/// Runs the experiment into `folder`, or finishes what was begun there; `fresh` begins again.
pub(crate) fn run(experiment: &Experiment, folder: &Path, fresh: bool) -> Result<()> {
    let folder = RunFolder::open(folder, fresh)?;
    folder.write("config.toml", &experiment.resolved)?;
    let results = data::with_source(
        &experiment.data,
        Run {
            experiment,
            folder: &folder,
        },
    )?;
    results.write(folder.path())?;
    report::write(folder.path())?;
    folder.seal()
}

struct Run<'a> {
    experiment: &'a Experiment,
    folder: &'a RunFolder,
}

impl WithSource for Run<'_> {
    type Output = Results;

    fn call<S: Source>(self, source: &S, about: About) -> Result<Results> {
        let experiment = self.experiment;
        let splits = Splits::of(experiment, source.surfaces())?;
        let angles = source.view_angles();
        let methods = experiment.methods.iter().map(|m| m.on(angles.len()));
        let methods: Vec<Method> = methods.collect::<Result<_>>()?;
        let mut journals = Journals {
            trials: Journal::open(&self.folder.file(folder::TRIALS))?,
            selections: Journal::open(&self.folder.file(folder::SELECTIONS))?,
        };
        let mut rows: Vec<Option<MethodRow<'_>>> = methods.iter().map(|_| None).collect();
        let mut properties = Vec::new();
        for (encoder, members) in by_encoder(&methods) {
            let encoded = Encoded {
                run: &self,
                about: &about,
                encoder,
                methods: members.iter().map(|&at| &methods[at]).collect(),
                splits: &splits,
            };
            let (codes, done) = match encoder.network {
                Network::Images(_) => encoded.rows(source, None, &mut journals)?,
                Network::Sequences { frames } => {
                    let views = views::equidistant(source, frames)?;
                    let sequences = Sequences::new(source, views.clone());
                    encoded.rows(&sequences, Some(views), &mut journals)?
                }
            };
            for (at, row) in members.into_iter().zip(done) {
                rows[at] = Some(row);
            }
            properties = codes;
        }
        let rows: Vec<MethodRow<'_>> = rows.into_iter().flatten().collect();
        let all = rows.iter().flat_map(|row| row.outcomes.values().flatten());
        predictions::write(self.folder.path(), &predictions::of_outcomes(all))?;
        let provenance = provenance::of(experiment, source, &about)?;
        Ok(results(
            experiment,
            source,
            about,
            provenance,
            &properties,
            &splits,
            &rows,
        ))
    }
}

/// What a run has written down.
struct Journals {
    trials: Journal<Outcome>,
    selections: Journal<Found>,
}

/// The encoders of the methods in the order in which they come up, with the methods of each.
fn by_encoder(methods: &[Method]) -> Vec<(&EncoderSpec, Vec<usize>)> {
    let mut encoders: Vec<(&EncoderSpec, Vec<usize>)> = Vec::new();
    for (at, method) in methods.iter().enumerate() {
        match encoders
            .iter_mut()
            .find(|(spec, _)| **spec == method.encoder)
        {
            Some((_, members)) => members.push(at),
            None => encoders.push((&method.encoder, vec![at])),
        }
    }
    encoders
}

/// Methods that share an encoder.
struct Encoded<'a, 'm> {
    run: &'a Run<'a>,
    about: &'a About,
    encoder: &'a EncoderSpec,
    methods: Vec<&'m Method>,
    splits: &'a Splits,
}

impl<'m> Encoded<'_, 'm> {
    /// The codes of the properties, and the rows of the methods. `sequence` says what the one view
    /// of a source of sequences is made of.
    fn rows<S: Source>(
        &self,
        source: &S,
        sequence: Option<Vec<usize>>,
        journals: &mut Journals,
    ) -> Result<(Vec<String>, Vec<MethodRow<'m>>)> {
        let Self {
            run,
            about,
            encoder,
            methods,
            splits,
        } = self;
        let needed = views::needed(methods, source)?;
        let experiment = run.experiment;
        let stages = Stages::new(
            experiment,
            encoder,
            (source, about),
            splits,
            needed,
            sequence,
        )?;
        let mut groups = Encodings::of_splits(&stages, encoder, &splits.all)?;
        if methods.iter().any(|method| method.in_hindsight()) {
            for group in &mut groups {
                group.look_at_all(experiment, source, &splits.all)?;
            }
        }
        let selections = run.select(&groups, splits, methods, journals)?;
        let mut trials: Vec<Vec<TrialSpec>> = methods.iter().map(|_| Vec::new()).collect();
        for group in &mut groups {
            let planned = self.planned(group, &selections)?;
            let of_method = methods
                .iter()
                .copied()
                .zip(planned.iter().map(Vec::as_slice));
            group.look(experiment, source, &splits.all, of_method)?;
            for ((method, planned), all) in methods.iter().zip(planned).zip(&mut trials) {
                let own = splits.of_method(method, experiment.seed)?;
                let specs = trials::keyed(experiment, method, group, &own.all, planned)?;
                let journal = &mut journals.trials;
                fit::run_missing(experiment, method, group, &own, &specs, journal)?;
                all.extend(specs);
            }
        }
        let trained = methods.iter().zip(trials);
        let trained = trained.map(|(method, trials)| Trained::of(method, trials, &journals.trials));
        let trained = trained.collect::<Result<Vec<_>>>()?;
        let stage = &groups[0].stage;
        let costs = self.costs(source, stage, &trained)?;
        let train_seconds = groups.iter().map(|group| group.stage.train_seconds).sum();
        let rows = trained.into_iter().zip(costs).map(|(trained, costs)| {
            let costs = Costs {
                encoder_train_seconds: train_seconds,
                ..costs
            };
            trained.row(costs, &selections)
        });
        let rows = rows.collect();
        Ok((stage.tables.codes(), rows))
    }

    /// The trials of each method on the splits of a group.
    fn planned(&self, group: &Encodings, selections: &Selections) -> Result<Vec<Vec<Planned>>> {
        let (experiment, splits) = (self.run.experiment, &self.splits.all);
        let tables = &group.stage.tables;
        let of = |method: &&Method| {
            let some = group.splits.clone();
            trials::planned(experiment, method, tables, splits, some, selections)
        };
        self.methods.iter().map(of).collect()
    }

    /// What an estimate of each method costs; nothing where it looks at nothing.
    fn costs<S: Source>(
        &self,
        source: &S,
        stage: &Stage,
        trained: &[Trained<'_>],
    ) -> Result<Vec<Costs>> {
        let looks = |trained: &&Trained<'_>| trained.method.looks != Looks::Nothing;
        let asked = trained
            .iter()
            .filter(looks)
            .map(|method| method.asked(stage));
        let asked: Vec<Asked<'_>> = asked.collect();
        let mut measured = costs::measure(source, self.splits, &asked)?.into_iter();
        let of = |trained: &Trained<'_>| match trained.method.looks {
            Looks::Nothing => Costs::default(),
            _ => measured.next().unwrap_or_default(),
        };
        Ok(trained.iter().map(of).collect())
    }
}

impl Run<'_> {
    /// The views of all methods that select some.
    fn select(
        &self,
        groups: &[Encodings],
        splits: &Splits,
        methods: &[&Method],
        journals: &mut Journals,
    ) -> Result<Selections> {
        let mut selections = Selections::default();
        for group in groups {
            let mut selecting = Selecting {
                experiment: self.experiment,
                encodings: group,
                splits,
                journal: &mut journals.selections,
            };
            selecting.run(methods, group.splits.clone(), &mut selections)?;
        }
        Ok(selections)
    }
}

/// A method whose trials have all been run.
struct Trained<'m> {
    method: &'m Method,
    trials: Vec<TrialSpec>,
    /// By property, in the order of the reruns.
    outcomes: BTreeMap<String, Vec<Outcome>>,
    /// Where it stopped, if it looks at one view after the other.
    stops: Vec<Stop>,
}

impl<'m> Trained<'m> {
    fn of(method: &'m Method, trials: Vec<TrialSpec>, journal: &Journal<Outcome>) -> Result<Self> {
        let outcomes = outcomes(&trials, journal)?;
        let stops = outcomes.values().flatten().flat_map(|o| &o.stops);
        Ok(Self {
            method,
            stops: stops.copied().collect(),
            trials,
            outcomes,
        })
    }

    fn asked<'a>(&'a self, stage: &'a Stage) -> Asked<'a> {
        Asked {
            stage,
            method: self.method,
            trials: &self.trials,
            stops: &self.stops,
        }
    }

    fn row(self, costs: Costs, selections: &Selections) -> MethodRow<'m> {
        MethodRow {
            costs,
            found: found(&self.trials, self.method, selections),
            outcomes: self.outcomes,
            method: self.method,
        }
    }
}

/// A method with all its outcomes, by property, in the order of the reruns.
struct MethodRow<'a> {
    method: &'a Method,
    outcomes: BTreeMap<String, Vec<Outcome>>,
    /// What its selector found, likewise.
    found: BTreeMap<String, Vec<Found>>,
    costs: Costs,
}

impl MethodRow<'_> {
    /// Its outcomes, the folds of a rerun together.
    fn judged(&self, of_rerun: usize) -> PerProperty<Vec<Judged<'_>>> {
        let of_property = self.outcomes.iter().map(|(property, outcomes)| {
            let outcomes: Vec<&Outcome> = outcomes.iter().collect();
            let reruns = outcomes.chunks(of_rerun).filter_map(Judged::of);
            (property.clone(), reruns.collect())
        });
        of_property.collect()
    }
}

fn found(
    trials: &[TrialSpec],
    method: &Method,
    selections: &Selections,
) -> BTreeMap<String, Vec<Found>> {
    let mut all: BTreeMap<String, Vec<Found>> = BTreeMap::new();
    for trial in trials {
        if let Some(found) = selections.get(&method.id, trial.property, trial.rerun) {
            let of_property = all.entry(trial.property.to_string()).or_default();
            of_property.push(found.clone());
        }
    }
    all
}

fn outcomes(
    trials: &[TrialSpec],
    journal: &Journal<Outcome>,
) -> Result<BTreeMap<String, Vec<Outcome>>> {
    let mut outcomes: BTreeMap<String, Vec<Outcome>> = BTreeMap::new();
    for trial in trials {
        let outcome = journal.get(&trial.key).context("a trial was not run")?;
        let of_property = outcomes.entry(trial.property.to_string()).or_default();
        of_property.push(outcome.clone());
    }
    Ok(outcomes)
}

fn results<S: Source>(
    experiment: &Experiment,
    source: &S,
    about: About,
    provenance: Provenance,
    properties: &[String],
    splits: &Splits,
    rows: &[MethodRow<'_>],
) -> Results {
    let numbers = source.surfaces().iter().zip(splits.units.of_surface());
    let units = numbers
        .map(|(surface, &unit)| (surface.id.clone(), unit))
        .collect();
    let scoring = Scoring {
        properties,
        units: &units,
        top8: paper::top8(),
        bootstrap: experiment.bootstrap,
    };
    let training_surfaces = splits.training_surfaces();
    let methods: Vec<MethodOutcomes<'_>> = rows
        .iter()
        .map(|row| MethodOutcomes {
            id: &row.method.id,
            label: &row.method.label,
            kind: row.method.estimator.kind(),
            encoder: match row.method.looks {
                Looks::Nothing => String::new(),
                _ => encoder::describe(&row.method.encoder),
            },
            precision: row.method.precision().unwrap_or_default(),
            adaptive: row.method.adaptive,
            paper: row.method.paper.as_deref(),
            reruns: experiment.reruns,
            training_surfaces: row.method.training_surfaces.unwrap_or(training_surfaces),
            outcomes: row.judged(splits.of_rerun),
            costs: row.costs,
            selections: selection::summaries(row, rows, source.view_angles()),
        })
        .collect();
    let against = experiment.against.iter().filter_map(|&at| methods.get(at));
    let against = against.map(|method| method.id.to_owned());
    let methods: Vec<MethodResult> = methods
        .par_iter()
        .map(|method| score(method, &methods, &experiment.against, &scoring))
        .collect();
    Results {
        provenance,
        experiment: experiment.name.clone(),
        description: experiment.description.clone(),
        dataset: dataset(experiment, source, &about, splits),
        properties: properties.to_vec(),
        interval_level: experiment.interval_level.get(),
        against: against.collect(),
        speed: experiment.speed.map(|asked| Speed::of(&methods, asked)),
        methods,
        notes: about.notes,
    }
}

/// The encoders of the methods in words; what each has stands beside it where there are several.
fn encoders(methods: &[Method]) -> String {
    match by_encoder(methods).as_slice() {
        [(encoder, _)] => encoder::describe(encoder),
        several => format!("{} settings, named beside each method", several.len()),
    }
}

fn dataset<S: Source>(
    experiment: &Experiment,
    source: &S,
    about: &About,
    splits: &Splits,
) -> Dataset {
    let ceiling = |of: fn(&sps_simulate::Ceiling) -> f64| {
        let ceilings = about.ceilings.iter().flat_map(|c| &c.properties);
        ceilings
            .map(|(code, ceiling)| ((*code).clone(), of(ceiling)))
            .collect()
    };
    Dataset {
        name: source.name().to_owned(),
        simulated: about.simulated,
        published_sps: about.published_sps,
        surfaces: source.surfaces().len(),
        training_surfaces: splits.training_surfaces(),
        unit: Some(splits.units.unit()),
        units: splits.units.count(),
        views: source.view_angles().len(),
        view_angles_deg: source.view_angles().iter().map(|angle| angle.0).collect(),
        encoder: encoders(&experiment.methods),
        ceiling_one_view: ceiling(|ceiling| ceiling.nadir),
        ceiling_all_views: ceiling(|ceiling| ceiling.all),
    }
}
