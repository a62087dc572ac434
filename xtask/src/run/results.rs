//! The results of a run, from the rows of its methods.

use std::iter;

use anyhow::Result;
use rayon::prelude::*;
use sps_dataset::Source;
use sps_simulate::Ceiling;
use tracing::info;

use super::found::Found;
use super::{Splits, by_encoder, provenance, selection, what_is_measured};
use crate::config::{Experiment, Looks, Method};
use crate::data::About;
use crate::encoder;
use crate::journal::Outcome;
use crate::paper;
use crate::results::{
    Costs, Dataset, Judged, MethodOutcomes, MethodResult, PerProperty, Results, Scoring, Speed,
    score,
};

/// A method with all its outcomes, by property, in the order of the reruns.
pub(super) struct MethodRow<'a> {
    pub method: &'a Method,
    pub outcomes: PerProperty<Vec<Outcome>>,
    /// What its selector found, likewise.
    pub found: PerProperty<Vec<Found>>,
    pub costs: Costs,
}

impl MethodRow<'_> {
    /// One of `rows`, ready to be scored.
    fn outcomes<S: Source>(
        &self,
        rows: &[MethodRow<'_>],
        experiment: &Experiment,
        source: &S,
        splits: &Splits,
    ) -> Result<MethodOutcomes<'_>> {
        let method = self.method;
        let trained_on = splits
            .of_method(method, experiment.seed)?
            .training_surfaces();
        let row = MethodResult {
            id: method.id.clone(),
            label: method.label.clone(),
            kind: method.estimator.kind().to_owned(),
            encoder: match method.looks {
                Looks::Nothing => String::new(),
                _ => encoder::describe(&method.encoder),
            },
            precision: method.precision().unwrap_or_default(),
            paper: method.paper.clone(),
            reruns: experiment.reruns,
            training_surfaces: trained_on,
            notes: method.estimator.thinned(trained_on).into_iter().collect(),
            costs: self.costs,
            selections: selection::summaries(self, rows, source.view_angles()),
            ..MethodResult::default()
        };
        Ok(MethodOutcomes {
            row,
            adaptive: method.adaptive,
            outcomes: self.judged(splits.of_rerun),
        })
    }

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

/// Scores the rows; `properties` are the codes of those estimated, in the order of the reports.
pub(super) fn results<S: Source>(
    experiment: &Experiment,
    source: &S,
    about: &About,
    properties: Vec<String>,
    splits: &Splits,
    rows: &[MethodRow<'_>],
) -> Result<Results> {
    let numbers = source.surfaces().iter().zip(splits.units.of_surface());
    let units = numbers
        .map(|(surface, &unit)| (surface.id.clone(), unit))
        .collect();
    let scoring = Scoring {
        properties: &properties,
        units: &units,
        top8: paper::top8(),
        bootstrap: experiment.bootstrap,
    };
    let outcomes = rows.iter();
    let outcomes: Vec<MethodOutcomes<'_>> = outcomes
        .map(|row| row.outcomes(rows, experiment, source, splits))
        .collect::<Result<_>>()?;
    let methods: Vec<MethodResult> = outcomes
        .par_iter()
        .map(|method| score(method, &outcomes, &experiment.against, &scoring))
        .collect();
    let measured = what_is_measured(splits, source.surfaces());
    info!("{measured}");
    let against = experiment.against.iter().filter_map(|&at| methods.get(at));
    Ok(Results {
        provenance: provenance::of(experiment, source, about)?,
        experiment: experiment.name.clone(),
        description: experiment.description.clone(),
        dataset: dataset(experiment, source, about, splits),
        interval_level: experiment.interval_level.get(),
        against: against.map(|method| method.id.clone()).collect(),
        speed: experiment.speed.map(|asked| Speed::of(&methods, asked)),
        methods,
        properties,
        notes: iter::once(measured)
            .chain(about.notes.iter().cloned())
            .collect(),
    })
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
    let ceiling = |of: fn(&Ceiling) -> f64| {
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
