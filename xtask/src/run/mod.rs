//! Running an experiment: embed, fit what is missing, score, report.

mod adaptive;
mod costs;
mod encoded;
mod encodings;
mod fit;
mod floors;
mod folder;
mod found;
mod frozen;
mod provenance;
mod refit;
mod results;
mod select;
mod selection;
mod splits;
mod stage;
mod tables;
mod test_views;
mod trials;
pub(crate) mod views;

use std::path::Path;

use anyhow::Result;
use sps_dataset::Source;

pub(crate) use encodings::Encodings;
pub(crate) use folder::{CONFIG, RunFolder};
pub(crate) use found::Selections;
pub(crate) use frozen::Folds;
pub(crate) use select::Selecting;
pub(crate) use splits::Splits;
pub(crate) use stage::{Stage, Stages};
pub(crate) use tables::Tables;

use crate::config::{EncoderSpec, Experiment, Method, Network};
use crate::data::{self, About, WithSource};
use crate::journal::{Journal, Outcome};
use crate::report::{self, predictions};
use crate::results::Results;
use crate::sequences::Sequences;
use encoded::Encoded;
use found::Found;
use results::{MethodRow, results};

/// Runs the experiment into `folder`, or finishes what was begun there; `fresh` begins again.
pub(crate) fn run(experiment: &Experiment, folder: &Path, fresh: bool) -> Result<Results> {
    let folder = RunFolder::open(folder, fresh)?;
    folder.write(folder::CONFIG, &experiment.resolved)?;
    let results = data::with_source(
        &experiment.data,
        Run {
            experiment,
            folder: &folder,
        },
    )?;
    results.write(folder.path())?;
    report::write(folder.path())?;
    folder.seal()?;
    Ok(results)
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
                experiment,
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
        let estimates = predictions::of_outcomes(all, &splits.groups(source.surfaces()));
        predictions::write(self.folder.path(), &estimates)?;
        results(experiment, source, about, properties, &splits, &rows)
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
