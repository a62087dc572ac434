//! Running an experiment: embed, fit what is missing, score, report.

mod costs;
mod fit;
mod folder;
mod tables;
mod trials;

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use sps_dataset::{Source, Split};
use tracing::info;

pub(crate) use fit::{Fitted, fit};
pub(crate) use tables::Tables;
pub(crate) use trials::splits;

use crate::config::{Experiment, Method};
use crate::data::{self, About, WithSource};
use crate::embeddings::{Embedder, EmbeddingCache, embed_views};
use crate::encoder;
use crate::journal::{Journal, Outcome};
use crate::report::{self, paper, predictions};
use crate::results::{Costs, Dataset, MethodOutcomes, Results, Scoring, score};
use folder::RunFolder;
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
    report::write(folder.path())
}

/// Embeds the views that the experiment's methods look at, of every surface.
pub(crate) fn tables<S: Source>(
    experiment: &Experiment,
    source: &S,
    about: &About,
    embedder: &Embedder,
) -> Result<Tables> {
    let cache = EmbeddingCache::open(&experiment.cache, embedder.identity(), embedder.width())?;
    let views = [data::nadir(source)?];
    let embeddings = embed_views(source, &views, embedder, &cache)?;
    info!(
        "{} embeddings of {} surfaces, {} of them encoded now",
        source.surfaces().len() * views.len(),
        source.surfaces().len(),
        embeddings.frames_decoded
    );
    Tables::new(source, about, &embeddings, &experiment.properties)
}

struct Run<'a> {
    experiment: &'a Experiment,
    folder: &'a RunFolder,
}

impl WithSource for Run<'_> {
    type Output = Results;

    fn call<S: Source>(self, source: &S, about: About) -> Result<Results> {
        let experiment = self.experiment;
        let embedder = encoder::embedder(&experiment.encoder, experiment.seed)?;
        let tables = tables(experiment, source, &about, &embedder)?;
        let splits = splits(experiment, &tables.surfaces)?;
        let mut journal = Journal::open(&self.folder.file("trials.jsonl"))?;
        let mut rows = Vec::new();
        for method in &experiment.methods {
            let trials = trials::trials(experiment, method, &tables, &splits)?;
            fit::run_missing(experiment, method, &tables, &splits, &trials, &mut journal)?;
            rows.push(MethodRow {
                costs: costs::measure(source, &embedder, method, &tables, &splits[0], &trials)?,
                outcomes: outcomes(&trials, &journal)?,
                method,
            });
        }
        let all = rows.iter().flat_map(|row| row.outcomes.values().flatten());
        predictions::write(self.folder.path(), &predictions::of_outcomes(all))?;
        Ok(results(experiment, source, about, &tables, &splits, &rows))
    }
}

/// A method with all its outcomes, by property, in the order of the reruns.
struct MethodRow<'a> {
    method: &'a Method,
    outcomes: BTreeMap<String, Vec<Outcome>>,
    costs: Costs,
}

fn outcomes(trials: &[TrialSpec], journal: &Journal) -> Result<BTreeMap<String, Vec<Outcome>>> {
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
    tables: &Tables,
    splits: &[Split],
    rows: &[MethodRow<'_>],
) -> Results {
    let scoring = Scoring {
        properties: &tables.codes(),
        top8: paper::top8(),
        bootstrap: experiment.bootstrap,
    };
    let methods: Vec<MethodOutcomes<'_>> = rows
        .iter()
        .map(|row| MethodOutcomes {
            id: &row.method.id,
            label: &row.method.label,
            paper: row.method.paper.as_deref(),
            reruns: splits.len(),
            outcomes: row
                .outcomes
                .iter()
                .map(|(property, outcomes)| (property.clone(), outcomes.iter().collect()))
                .collect(),
            costs: row.costs,
        })
        .collect();
    Results {
        experiment: experiment.name.clone(),
        description: experiment.description.clone(),
        dataset: dataset(experiment, source, &about),
        properties: tables.codes(),
        interval_level: experiment.interval_level.get(),
        methods: methods
            .iter()
            .map(|method| score(method, methods.first(), &scoring))
            .collect(),
        notes: about.notes,
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
        encoder: encoder::describe(&experiment.encoder),
        ceiling_one_view: ceiling(|ceiling| ceiling.nadir),
        ceiling_all_views: ceiling(|ceiling| ceiling.all),
    }
}
