//! The results of a run, from the rows of its methods.

use std::sync::OnceLock;

use anyhow::{Context, Result};
use sps_base::parallel;
use sps_dataset::{Description, Property, Source};
use sps_metrics::{Intervals, Moments};
use sps_simulate::Ceiling;
use tracing::info;

use super::found::{self, Found, Selections};
use super::tables::{self, codes};
use super::trials::TrialSpec;
use super::{Splits, by_encoder, provenance, what_is_measured};
use crate::config::{Experiment, Looks, Method};
use crate::data::About;
use crate::encoder;
use crate::journal::{Journal, Outcome};
use crate::paper;
use crate::results::{
    Costs, Dataset, Described, Judged, MethodOutcomes, MethodResult, Numbers, PerProperty, Results,
    Scoring, Speed, score,
};

/// A method with all its outcomes, by property, in the order of the reruns.
pub(super) struct MethodRow<'a> {
    pub method: &'a Method,
    pub trials: Vec<TrialSpec>,
    pub outcomes: PerProperty<Vec<Outcome>>,
    /// What its selector found, likewise.
    pub found: PerProperty<Vec<Found>>,
    pub costs: Costs,
}

impl<'m> MethodRow<'m> {
    /// Of trials that have all been run; its costs are not measured yet.
    pub(super) fn of(
        method: &'m Method,
        trials: Vec<TrialSpec>,
        journal: &Journal<Outcome>,
        selections: &Selections,
    ) -> Result<Self> {
        let (mut outcomes, mut found) = (PerProperty::new(), PerProperty::new());
        for trial in &trials {
            let property = trial.property.to_string();
            let outcome = journal.get(&trial.key).context("a trial was not run")?;
            let mut outcome = outcome.clone();
            if outcome.rerun != trial.rerun {
                // Fitted once for several reruns.
                outcome.rerun = trial.rerun;
                outcome.train_seconds = 0.0;
            }
            if let Some(one) = selections.get(&method.id, &trial.property, trial.rerun) {
                let found: &mut Vec<_> = found.entry(property.clone()).or_default();
                found.push(one.clone());
            }
            let outcomes: &mut Vec<_> = outcomes.entry(property).or_default();
            outcomes.push(outcome);
        }
        Ok(Self {
            method,
            trials,
            outcomes,
            found,
            costs: Costs::default(),
        })
    }

    /// One of `rows`, ready to be scored.
    fn outcomes(
        &self,
        rows: &[MethodRow<'_>],
        experiment: &Experiment,
        source: &dyn Source,
        splits: &Splits,
        numbers: &Numbers<'_>,
    ) -> Result<MethodOutcomes<'_>> {
        let method = self.method;
        let trained_on = splits.of_method(method, experiment.seed)?;
        let trained_on = trained_on.training_surfaces();
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
            selections: found::summaries(self, rows, source.view_angles()),
            ..MethodResult::default()
        };
        Ok(MethodOutcomes {
            row,
            adaptive: method.adaptive,
            outcomes: self.judged(splits.of_rerun, numbers),
            r2: OnceLock::new(),
        })
    }

    /// Its outcomes, the folds of a rerun together.
    fn judged(&self, of_rerun: usize, numbers: &Numbers<'_>) -> PerProperty<Vec<Judged<'_>>> {
        let of_property = self.outcomes.iter().map(|(property, outcomes)| {
            let reruns = outcomes.chunks(of_rerun).enumerate();
            let judged = reruns.map(|(rerun, folds)| Judged::of(rerun, folds, numbers));
            (property.clone(), judged.collect())
        });
        of_property.collect()
    }
}

/// Scores the rows.
pub(super) fn results(
    experiment: &Experiment,
    source: &dyn Source,
    about: &About,
    splits: &Splits,
    rows: &[MethodRow<'_>],
) -> Result<Results> {
    let properties = codes(&tables::properties(source, &experiment.properties)?);
    let surfaces = source.surfaces().iter().enumerate();
    let numbers = surfaces.zip(splits.units.of_surface());
    let numbers = numbers.map(|((number, surface), &unit)| (&surface.id[..], [number, unit]));
    let numbers: Numbers<'_> = numbers.collect();
    let described = described(source, about, &properties);
    let dataset = dataset(experiment, source, about, splits);
    let after_the_paper = dataset.is_after_the_paper();
    let (with_percentages, without): (Vec<String>, Vec<String>) =
        properties.iter().cloned().partition(|code| {
            let range = described.get(code).and_then(|known| known.range);
            after_the_paper || range.is_some_and(|[low, high]| low > 0.0 || high < 0.0)
        });
    let deviations = described.iter();
    let deviations = deviations.map(|(code, known)| (code.clone(), known.std));
    let deviations = deviations.collect();
    let measured = what_is_measured(splits, source.surfaces());
    info!("{measured}");
    let mut notes = vec![measured];
    notes.extend(about.notes.iter().cloned());
    if !without.is_empty() {
        notes.push(format!(
            "no percentage error of {}: their values touch zero or lie on both sides of it, where a \
             percentage means nothing",
            without.join(", ")
        ));
    }
    let test_per_training = splits.test_per_training();
    let scoring = Scoring {
        properties: &properties,
        with_percentages: &with_percentages,
        deviations: &deviations,
        own_mean_interval: dataset.holds_out_groups(),
        top8: if after_the_paper { paper::top8() } else { &[] },
        intervals: Intervals::of_training(experiment.interval_level).sharing(test_per_training),
    };
    let outcomes = parallel::map(rows, |row| {
        row.outcomes(rows, experiment, source, splits, &numbers)
    });
    let outcomes: Vec<MethodOutcomes<'_>> = outcomes.into_iter().collect::<Result<_>>()?;
    let scored = |method| score(method, &outcomes, &experiment.against, &scoring);
    let methods: Vec<MethodResult> = parallel::map(&outcomes, scored);
    let against = experiment.against.iter().filter_map(|&at| methods.get(at));
    Ok(Results {
        provenance: provenance::of(experiment, source, about)?,
        experiment: experiment.name.clone(),
        description: experiment.description.clone(),
        dataset,
        interval_level: experiment.interval_level.get(),
        test_per_training: Some(test_per_training),
        against: against.map(|method| method.id.clone()).collect(),
        speed: experiment.speed.map(|asked| Speed::of(&methods, asked)),
        methods,
        properties,
        described,
        notes,
    })
}

/// What is known of the properties, and how far their values differ over the surfaces.
fn described(source: &dyn Source, about: &About, properties: &[String]) -> PerProperty<Described> {
    let table = source.tactile();
    let averages = table.averages(&about.tactile, source.surfaces().len());
    let wanted = |property: &&Property| properties.iter().any(|code| *code == property.code());
    let described = table.properties.iter().filter(wanted).map(|property| {
        let Description { name, unit, .. } = source.describe(property);
        let values: Vec<f64> = averages.column(property).into_iter().flatten().collect();
        let low = values.iter().copied().reduce(f64::min);
        let range = low.zip(values.iter().copied().reduce(f64::max));
        let moments: Moments = values.iter().copied().collect();
        let known = Described {
            name,
            unit,
            std: moments.sample_std().unwrap_or_default(),
            range: range.map(|(low, high)| [low, high]),
        };
        (property.to_string(), known)
    });
    described.collect()
}

fn dataset(
    experiment: &Experiment,
    source: &dyn Source,
    about: &About,
    splits: &Splits,
) -> Dataset {
    let ceiling = |of: fn(&Ceiling) -> f64| {
        let ceilings = about.ceilings.iter().flat_map(|all| &all.properties);
        let ceilings = ceilings.map(|(code, ceiling)| (code.clone(), of(ceiling)));
        ceilings.collect()
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
        encoder: match by_encoder(&experiment.methods).as_slice() {
            [(encoder, _)] => encoder::describe(encoder),
            several => format!("{} settings, named beside each method", several.len()),
        },
        ceiling_one_view: ceiling(|ceiling| ceiling.nadir),
        ceiling_all_views: ceiling(|ceiling| ceiling.all),
    }
}
