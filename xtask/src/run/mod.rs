//! Running an experiment: embed, fit what is missing, score, report.

mod adaptive;
mod costs;
mod fit;
mod folder;
mod select;
mod selection;
mod stage;
mod tables;
mod trials;
mod views;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use sps_dataset::{Source, Split};

use costs::Asked;
pub(crate) use fit::{Fitted, fit};
pub(crate) use folder::seal;
pub(crate) use stage::{Stage, Stages};
pub(crate) use tables::Tables;
pub(crate) use trials::splits;

use crate::config::{EncoderSpec, Estimator, Experiment, Method, Network};
use crate::data::{self, About, WithSource};
use crate::encoder;
use crate::journal::{Journal, Outcome, Stop};
use crate::report::{self, paper, predictions};
use crate::results::{
    Costs, Dataset, MethodOutcomes, MethodResult, Results, Scoring, Speed, score,
};
use crate::sequences::Sequences;
use folder::RunFolder;
use select::{Found, Selecting, Selections};
use trials::TrialSpec;

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
        let splits = splits(experiment, source.surfaces())?;
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
        Ok(results(
            experiment,
            source,
            about,
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
    splits: &'a [Split],
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
        let stages = Stages::new(run.experiment, encoder, source, about, needed, sequence)?;
        let groups = groups(&stages, encoder, splits)?;
        let selections = run.select(&groups, splits, methods, journals)?;
        let trained = methods
            .iter()
            .map(|method| run.train(method, (&groups, &selections), splits, journals));
        let trained = trained.collect::<Result<Vec<_>>>()?;
        let stage = &groups[0].stage;
        let asked: Vec<Asked<'_>> = trained.iter().map(|method| method.asked(stage)).collect();
        let costs = costs::measure(source, &splits[0], &asked)?;
        let train_seconds = groups.iter().map(|group| group.stage.train_seconds).sum();
        let rows = trained.into_iter().zip(costs).map(|(trained, costs)| {
            let costs = Costs {
                encoder_train_seconds: train_seconds,
                ..costs
            };
            trained.row(costs, &selections)
        });
        let rows = rows.collect();
        Ok((groups[0].stage.tables.codes(), rows))
    }
}

impl Run<'_> {
    /// The views of all methods that select some.
    fn select(
        &self,
        groups: &[Group],
        splits: &[Split],
        methods: &[&Method],
        journals: &mut Journals,
    ) -> Result<Selections> {
        let mut selections = Selections::default();
        for Group { stage, reruns } in groups {
            let mut selecting = Selecting {
                experiment: self.experiment,
                tables: &stage.tables,
                splits,
                journal: &mut journals.selections,
            };
            selecting.run(methods, reruns.clone(), &mut selections)?;
        }
        Ok(selections)
    }

    /// Runs what is missing of a method.
    fn train<'m>(
        &self,
        method: &'m Method,
        (groups, selections): (&[Group], &Selections),
        splits: &[Split],
        journals: &mut Journals,
    ) -> Result<Trained<'m>> {
        let experiment = self.experiment;
        let journal = &mut journals.trials;
        let mut all = Vec::new();
        for Group { stage, reruns } in groups {
            let tables = &stage.tables;
            let reruns = reruns.clone();
            let trials = trials::trials(experiment, method, tables, splits, reruns, selections)?;
            fit::run_missing(experiment, method, tables, splits, &trials, journal)?;
            all.extend(trials);
        }
        let outcomes = outcomes(&all, journal)?;
        let stops = outcomes.values().flatten().flat_map(|o| &o.stops);
        Ok(Trained {
            method,
            stops: stops.copied().collect(),
            trials: all,
            outcomes,
        })
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

/// Reruns that look at the same embeddings.
struct Group {
    stage: Arc<Stage>,
    reruns: Range<usize>,
}

/// All reruns together, or each on its own where an encoder is trained for each.
fn groups<S: Source>(
    stages: &Stages<'_, S>,
    encoder: &EncoderSpec,
    splits: &[Split],
) -> Result<Vec<Group>> {
    let group = |reruns: Range<usize>| {
        let stage = stages.of(&splits[reruns.start].train)?;
        Ok(Group { stage, reruns })
    };
    if encoder.training.is_none() {
        return Ok(vec![group(0..splits.len())?]);
    }
    (0..splits.len())
        .map(|rerun| group(rerun..rerun + 1))
        .collect()
}

/// A method with all its outcomes, by property, in the order of the reruns.
struct MethodRow<'a> {
    method: &'a Method,
    outcomes: BTreeMap<String, Vec<Outcome>>,
    /// What its selector found, likewise.
    found: BTreeMap<String, Vec<Found>>,
    costs: Costs,
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
    properties: &[String],
    splits: &[Split],
    rows: &[MethodRow<'_>],
) -> Results {
    let scoring = Scoring {
        properties,
        top8: paper::top8(),
        bootstrap: experiment.bootstrap,
    };
    let methods: Vec<MethodOutcomes<'_>> = rows
        .iter()
        .map(|row| MethodOutcomes {
            id: &row.method.id,
            label: &row.method.label,
            kind: match row.method.estimator {
                Estimator::Head(_) => "head",
                Estimator::Ridge(_) => "ridge",
            },
            encoder: encoder::describe(&row.method.encoder),
            adaptive: row.method.adaptive,
            paper: row.method.paper.as_deref(),
            reruns: splits.len(),
            outcomes: row
                .outcomes
                .iter()
                .map(|(property, outcomes)| (property.clone(), outcomes.iter().collect()))
                .collect(),
            costs: row.costs,
            selections: selection::summaries(row, rows, source.view_angles()),
        })
        .collect();
    let against = experiment.against.iter().filter_map(|&at| methods.get(at));
    let against = against.map(|method| method.id.to_owned());
    let methods: Vec<MethodResult> = methods
        .iter()
        .map(|method| score(method, &methods, &experiment.against, &scoring))
        .collect();
    Results {
        experiment: experiment.name.clone(),
        description: experiment.description.clone(),
        dataset: dataset(experiment, source, &about),
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

fn dataset<S: Source>(experiment: &Experiment, source: &S, about: &About) -> Dataset {
    let ceiling = |of: fn(&sps_dataset::simulate::Ceiling) -> f64| {
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
        views: source.view_angles().len(),
        view_angles_deg: source.view_angles().iter().map(|angle| angle.0).collect(),
        encoder: encoders(&experiment.methods),
        ceiling_one_view: ceiling(|ceiling| ceiling.nadir),
        ceiling_all_views: ceiling(|ceiling| ceiling.all),
    }
}
